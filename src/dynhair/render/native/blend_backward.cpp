// Tiles [first, last): gradients of the blend with respect to the splats, front to back again.
//
// With R the sum over all later splats of weight times (gradient . features), less what the final transmittance is
// worth, the gradient of one alpha is T (gradient . features) - R / (1 - alpha).
//
// splats, starts, entries, reached, ends    as the forward left them
// image, alpha, depth, and grad_image, grad_alpha, grad_depth   (height, width, ...)
// grads           (n, stride), added to: of v = dL/dalpha * alpha the sums of v, v dx, v dy, v dx^2, v dx dy, v dy^2,
//                 a gap, and the gradients of depth and features

const int tiles_x = (width + TILE - 1) / TILE;
constexpr int STRIDE = FEATURES + CHANNELS, GROUPS = (STRIDE + 15) / 16, AHEAD = 12;

// Sums over the lanes of 16 vectors at once: lane i of the result is the sum of v[i].
auto lane_sums = [](const Vec* v) -> Vec {
    Vec a[8], b[4], c[2];
#pragma unroll
    for (int i = 0; i < 8; ++i)
        a[i] = __builtin_shufflevector(v[i], v[i + 8], 0, 1, 2, 3, 4, 5, 6, 7, 16, 17, 18, 19, 20, 21, 22, 23) +
               __builtin_shufflevector(v[i], v[i + 8], 8, 9, 10, 11, 12, 13, 14, 15, 24, 25, 26, 27, 28, 29, 30, 31);
#pragma unroll
    for (int i = 0; i < 4; ++i)
        b[i] = __builtin_shufflevector(a[i], a[i + 4], 0, 1, 2, 3, 16, 17, 18, 19, 8, 9, 10, 11, 24, 25, 26, 27) +
               __builtin_shufflevector(a[i], a[i + 4], 4, 5, 6, 7, 20, 21, 22, 23, 12, 13, 14, 15, 28, 29, 30, 31);
#pragma unroll
    for (int i = 0; i < 2; ++i)
        c[i] = __builtin_shufflevector(b[i], b[i + 2], 0, 1, 16, 17, 4, 5, 20, 21, 8, 9, 24, 25, 12, 13, 28, 29) +
               __builtin_shufflevector(b[i], b[i + 2], 2, 3, 18, 19, 6, 7, 22, 23, 10, 11, 26, 27, 14, 15, 30, 31);
    return __builtin_shufflevector(c[0], c[1], 0, 16, 2, 18, 4, 20, 6, 22, 8, 24, 10, 26, 12, 28, 14, 30) +
           __builtin_shufflevector(c[0], c[1], 1, 17, 3, 19, 5, 21, 7, 23, 9, 25, 11, 27, 13, 29, 15, 31);
};

for (int tile = first; tile < last; ++tile) {
    const int left = tile % tiles_x * TILE, top = tile / tiles_x * TILE;
    const int begin = starts[tile], end = ends[tile];
    if (begin == end) continue;
    pixels.enter(left, top, EXP2_SERIES);
    alignas(64) float transmittance[16][16], later[16][16];
    alignas(64) float gradient[16][1 + CHANNELS][16];  // of depth, then features
    for (int block = 0; block < 16; ++block)
        for (int l = 0; l < 16; ++l) {
            const int x = left + (block & 3) * BLOCK + (l & 3), y = top + (block >> 2) * BLOCK + (l >> 2);
            const bool inside = x < width && y < height;
            const i64 pixel = inside ? (i64)y * width + x : 0;
            const float covered = inside ? alpha[pixel] : 0.0f;
            const float of_depth = covered > 0.0f ? grad_depth[pixel] / covered : 0.0f;
            const float of_alpha = grad_alpha[pixel] - of_depth * depth[pixel];
            float sum = of_depth * depth[pixel] * covered - of_alpha * (1.0f - covered);
            gradient[block][0][l] = of_depth;
            for (int c = 0; c < CHANNELS; ++c) {
                const float g = inside && c < channels ? grad_image[pixel * channels + c] : 0.0f;
                gradient[block][1 + c][l] = g;
                if (c < channels) sum += g * image[pixel * channels + c];
            }
            transmittance[block][l] = inside ? 1.0f : 0.0f;
            later[block][l] = sum;
        }

    for (int entry = begin; entry < end; ++entry) {
        if (entry + AHEAD < end) {
            const i64 coming = (i64)entries[entry + AHEAD] * STRIDE;
            for (int k = 0; k < STRIDE; k += 16) {
                __builtin_prefetch(splats + coming + k);
                __builtin_prefetch(grads + coming + k, 1);
            }
        }
        unsigned blocks = reached[entry];
        if (!blocks) continue;
        const float* s = splats + (i64)entries[entry] * STRIDE;
        Vec sums[GROUPS * 16];
#pragma unroll
        for (int k = 0; k < GROUPS * 16; ++k) sums[k] = 0.0f;
        for (; blocks; blocks &= blocks - 1) {
            const int block = __builtin_ctz(blocks);
            const Vec t = Simd::load(transmittance[block]);
            const Coverage coverage(pixels, s, block, t);
            Simd::store(transmittance[block], coverage.after);

            Vec worth = 0.0f;  // gradient . features
#pragma unroll
            for (int c = 0; c <= CHANNELS; ++c) {
                const Vec g = Simd::load(gradient[block][c]);
                worth = Simd::fma(g, s[DEPTH + c], worth);
                sums[DEPTH + c] = Simd::fma(coverage.weight, g, sums[DEPTH + c]);
            }
            const Vec behind = Simd::fma(-coverage.weight, worth, Simd::load(later[block]));
            Simd::store(later[block], behind);
            // Not divided at once: the slow division need not wait for `behind`.
            const Vec of_alpha = t * worth - behind * (1.0f / (1.0f - coverage.alpha));
            const Vec drawn = Simd::keep(coverage.raw <= ALPHA_MAX, coverage.alpha);
            const Vec v = Simd::keep(coverage.weight > 0.0f, of_alpha * drawn);
            const Vec dx = coverage.dx, dy = coverage.dy, vx = v * dx, vy = v * dy;
            sums[0] += v;
            sums[1] += vx;
            sums[2] += vy;
            sums[3] = Simd::fma(vx, dx, sums[3]);
            sums[4] = Simd::fma(vx, dy, sums[4]);
            sums[5] = Simd::fma(vy, dy, sums[5]);
        }
        float* grad = grads + (i64)entries[entry] * STRIDE;
#pragma unroll
        for (int group = 0; group < GROUPS; ++group) {
            const Vec total = lane_sums(sums + 16 * group);
#pragma unroll
            for (int k = 0; k < 16; ++k)
                if (16 * group + k < STRIDE) grad[16 * group + k] += total[k];
        }
    }
}
