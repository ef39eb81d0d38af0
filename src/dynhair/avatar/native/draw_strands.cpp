// Strands [first, last) -> their Gaussians, and what each view sees of them.
//
// strands         (count, points, 3), widths (count,), taper (points - 1,): factors on a strand's width
// cameras         (views, 16)
// base, higher    (3, n) and (15, 3, n): harmonics of the n Gaussians
// means, quats, scales (n, 3), (n, 4), (n, 3); features (views, n, 7)

for (int strand = first; strand < last; ++strand)
    for (int segment = 0; segment < segments; segment += 16) {
        const int some = segments - segment < 16 ? segments - segment : 16, at = strand * segments + segment;
        const float* from = strands + 3 * ((i64)strand * points + segment);
        Vec a[3], b[3];
        columns_of(from, 3, some, a);
        columns_of(from + 3, 3, some, b);
        Segments s;
        s.enter(a, b);
        alignas(64) float across[16];
        for (int l = 0; l < 16; ++l) across[l] = 0.5f * widths[strand] * taper[l < some ? segment + l : segment];
        const Vec mean[3] = {s.middle(0), s.middle(1), s.middle(2)};
        const Vec quat[4] = {s.half_cosine, 0.0f, -s.half_sine * s.direction[2], s.half_sine * s.direction[1]};
        const Vec scale[3] = {0.5f * s.length, *(const Vec*)across, *(const Vec*)across};
        write_rows(mean, 3, some, means + (i64)3 * at);
        write_rows(quat, 4, some, quats + (i64)4 * at);
        write_rows(scale, 3, some, scales + (i64)3 * at);

        const int whole = total - at >= 16;  // whether 16 coefficients can be read at once
        for (int v = 0; v < views; ++v) {
            const Sight sight(cameras + 16 * v, s);
            Vec basis[COEFFICIENTS], seen[FEATURES];
            harmonics(cameras + 16 * v, s, basis);
            seen[0] = 1.0f;
            seen[1] = 0.0f;
            seen[2] = (sight.across * sight.across - sight.down * sight.down) * sight.scale;
            seen[3] = 2.0f * sight.across * sight.down * sight.scale;
            for (int c = 0; c < 3; ++c) {
                Vec sum = 0.5f;
                for (int k = 0; k < COEFFICIENTS; ++k) {
                    const float* coefficients = (k ? higher + ((i64)3 * (k - 1) + c) * total : base + (i64)c * total) + at;
                    Vec values = 0.0f;
                    if (whole) values = *(const Loose*)coefficients;
                    else
                        for (int l = 0; l < some; ++l) values[l] = coefficients[l];
                    sum += values * basis[k];
                }
                seen[4 + c] = __builtin_elementwise_max(sum, (Vec)0.0f);
            }
            write_rows(seen, FEATURES, some, features + FEATURES * ((i64)v * total + at));
        }
    }
