// Strands [first, last): gradients of their Gaussians and of what each view sees -> of points and harmonics.
//
// strands, cameras, features   as for draw_strands.cpp
// of_means, of_quats, of_scales, of_features   gradients of what that wrote
// of_strands      zero on entry; of_base, of_higher

for (int strand = first; strand < last; ++strand)
    for (int segment = 0; segment < segments; segment += 16) {
        const int some = segments - segment < 16 ? segments - segment : 16, at = strand * segments + segment;
        const i64 point = 3 * ((i64)strand * points + segment);
        Vec a[3], b[3], mean[3], quat[4], scale[3];
        columns_of(strands + point, 3, some, a);
        columns_of(strands + point + 3, 3, some, b);
        columns_of(of_means + (i64)3 * at, 3, some, mean);
        columns_of(of_quats + (i64)4 * at, 4, some, quat);
        columns_of(of_scales + (i64)3 * at, 3, some, scale);
        Segments s;
        s.enter(a, b);

        const Vec of_sine = quat[3] * s.direction[1] - quat[2] * s.direction[2];
        const Vec of_cosine = quat[0] - of_sine * s.half_sine / s.half_cosine;
        Vec direction[3] = {of_cosine * s.sign * 0.25f / s.half_cosine, quat[3] * s.half_sine, -quat[2] * s.half_sine};
        Vec coefficients[COEFFICIENTS][3];
        for (int v = 0; v < views; ++v) {
            const float* view = cameras + 16 * v;
            const i64 row = FEATURES * ((i64)v * total + at);
            const Sight sight(view, s);
            Vec basis[COEFFICIENTS], seen[FEATURES], of_seen[FEATURES];
            harmonics(view, s, basis);
            columns_of(features + row, FEATURES, some, seen);
            columns_of(of_features + row, FEATURES, some, of_seen);
            for (int c = 0; c < 3; ++c) {
                const Vec of_colour = seen[4 + c] > 0.0f ? of_seen[4 + c] : (Vec)0.0f;
                for (int k = 0; k < COEFFICIENTS; ++k)
                    coefficients[k][c] = basis[k] * of_colour + (v ? coefficients[k][c] : (Vec)0.0f);
            }

            const Vec x = sight.across, y = sight.down, cosine = of_seen[2], sine = of_seen[3];
            const Vec of_denominator = -(cosine * (x * x - y * y) + sine * 2.0f * x * y) * sight.scale * sight.scale;
            const Vec of_x = 2.0f * ((cosine * x + sine * y) * sight.scale + of_denominator * x);
            const Vec of_y = 2.0f * ((sine * x - cosine * y) * sight.scale + of_denominator * y) * view[15];
            const Vec pull = 2.0f * END_ON * END_ON * of_denominator;
            const Vec of_at[3] = {pull * sight.at[0] - of_x * sight.towards[2], pull * sight.at[1] - of_y * sight.towards[2],
                                  pull * sight.at[2] + of_x * sight.towards[0] + of_y * sight.towards[1]};
            const Vec of_towards[3] = {of_x * sight.at[2], of_y * sight.at[2],
                                       -of_x * sight.at[0] - of_y * sight.at[1]};
            for (int c = 0; c < 3; ++c)
                for (int r = 0; r < 3; ++r) {
                    mean[c] += view[3 * r + c] * of_at[r];
                    direction[c] += view[3 * r + c] * of_towards[r];
                }
        }
        for (int k = 0; k < COEFFICIENTS; ++k)
            for (int c = 0; c < 3; ++c) {
                float* to = (k ? of_higher + ((i64)3 * (k - 1) + c) * total : of_base + (i64)c * total) + at;
                if (some == 16) *(Loose*)to = coefficients[k][c];
                else
                    for (int l = 0; l < some; ++l) to[l] = coefficients[k][c][l];
            }

        Vec of_length = 0.5f * scale[0], of_start[3], of_end[3];
        for (int c = 0; c < 3; ++c) of_length -= direction[c] * s.direction[c] / s.length;
        for (int c = 0; c < 3; ++c) {
            const Vec of_along = direction[c] / s.length + of_length * s.direction[c];
            of_start[c] = 0.5f * mean[c] - of_along;
            of_end[c] = 0.5f * mean[c] + of_along;
        }
        for (int l = 0; l < some; ++l)
            for (int c = 0; c < 3; ++c) {
                of_strands[point + 3 * l + c] += of_start[c][l];
                of_strands[point + 3 * l + 3 + c] += of_end[c][l];
            }
    }
