// Gaussians [first, last) of the head -> the world. Arrays as for `Posed` in quaternions.cpp, and
//
// log_scales, logits   (n, 3), (n,) of standard deviations and opacities
// world_means, world_quats, posed_scales, posed_logits   what is written

for (int at = first; at < last; at += 16) {
    const int some = last - at < 16 ? last - at : 16;
    Posed p;
    p.enter(frames, reaches, means + (i64)3 * at, quats + (i64)4 * at, moved + (i64)3 * at, offsets + (i64)8 * at,
            follow + at, slots + at, shifts, turns, some);
    Vec mean[3];
    for (int c = 0; c < 3; ++c) mean[c] = p.with_body[c] + p.share * (p.with_head[c] - p.with_body[c]);
    const Vec quat[4] = {p.world.w, p.world.x, p.world.y, p.world.z};
    Rows::write(mean, 3, some, world_means + (i64)3 * at);
    Rows::write(quat, 4, some, world_quats + (i64)4 * at);
    for (int i = at; i < at + some; ++i) {
        const float* offset = offsets + (i64)8 * i;
        const float grown = slots[i] < 0 ? 0.0f : growth[slots[i]];
        for (int c = 0; c < 3; ++c) posed_scales[(i64)3 * i + c] = log_scales[(i64)3 * i + c] + reaches[1] * offset[c] + grown;
        posed_logits[i] = logits[i] + reaches[1] * offset[7];
    }
}
