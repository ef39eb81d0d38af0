// Gaussians [first, last): gradients of what pose_gaussians.cpp wrote -> of what it read, and of the frames.
//
// of_world_means, of_world_quats, of_posed_scales, of_posed_logits   given
// of_means        (n, 3): also of the shifts, and of `moved` over its reach
// of_quats, of_moved, of_offsets, of_follow   (n, ...)
// of_frames       (32,): sums over these Gaussians

Vec sums[32];
for (int k = 0; k < 32; ++k) sums[k] = 0.0f;
for (int at = first; at < last; at += 16) {
    const int some = last - at < 16 ? last - at : 16;
    Posed p;
    p.enter(frames, reaches, means + (i64)3 * at, quats + (i64)4 * at, moved + (i64)3 * at, offsets + (i64)8 * at,
            follow + at, slots + at, shifts, turns, some);
    Vec given[3], given_quat[4];
    Rows::read(of_world_means + (i64)3 * at, 3, some, given);
    Rows::read(of_world_quats + (i64)4 * at, 4, some, given_quat);
    for (int l = some; l < 16; ++l) {
        for (int c = 0; c < 3; ++c) given[c][l] = 0.0f;
        for (int k = 0; k < 4; ++k) given_quat[k][l] = 0.0f;
    }

    Vec of_share = 0.0f, mean[3] = {0.0f, 0.0f, 0.0f};
    for (int r = 0; r < 3; ++r) {
        const Vec by_head = p.share * given[r], by_body = given[r] - by_head;
        of_share += given[r] * (p.with_head[r] - p.with_body[r]);
        sums[9 + r] += by_head, sums[21 + r] += by_body;
        for (int c = 0; c < 3; ++c) {
            mean[c] += frames[3 * r + c] * by_head + frames[12 + 3 * r + c] * by_body;
            sums[3 * r + c] += by_head * p.mean[c];
            sums[12 + 3 * r + c] += by_body * p.mean[c];
        }
    }

    const Quaternions of_world = {given_quat[0], given_quat[1], given_quat[2], given_quat[3]};
    const Quaternions of_product =
        of_world.plus(p.world.times(-of_world.dot(p.world))).times(1.0f / p.blended_norm);
    const Quaternions of_between = of_product.after(p.local.conjugate());
    const Quaternions of_local = p.between.conjugate().after(of_product);
    of_share += of_between.dot(p.head.plus(p.body.times(-1.0f)));
    const Quaternions by_head = of_between.times(p.share), by_body = of_between.times(1.0f - p.share);
    sums[24] += by_head.w, sums[25] += by_head.x, sums[26] += by_head.y, sums[27] += by_head.z;
    sums[28] += by_body.w, sums[29] += by_body.x, sums[30] += by_body.y, sums[31] += by_body.z;
    const Quaternions of_canonical = p.turn.conjugate().after(of_local);
    const Quaternions of_quat =
        of_canonical.plus(p.canonical.times(-of_canonical.dot(p.canonical))).times(1.0f / p.norm);

    const Vec quat[4] = {of_quat.w, of_quat.x, of_quat.y, of_quat.z};
    Vec shift[3], offset[8], scale[3], logit;
    Rows::read(of_posed_scales + (i64)3 * at, 3, some, scale);
    Rows::read(of_posed_logits + at, 1, some, &logit);
    for (int c = 0; c < 3; ++c) shift[c] = reaches[0] * mean[c], offset[c] = reaches[1] * scale[c];
    for (int k = 0; k < 4; ++k) offset[3 + k] = reaches[1] * quat[k];
    offset[7] = reaches[1] * logit;
    Rows::write(mean, 3, some, of_means + (i64)3 * at);
    Rows::write(quat, 4, some, of_quats + (i64)4 * at);
    Rows::write(shift, 3, some, of_moved + (i64)3 * at);
    Rows::write(offset, 8, some, of_offsets + (i64)8 * at);
    Rows::write(&of_share, 1, some, of_follow + at);
}
for (int k = 0; k < 32; ++k) {
    float sum = 0.0f;
    for (int l = 0; l < 16; ++l) sum += sums[k][l];
    of_frames[k] = sum;
}
