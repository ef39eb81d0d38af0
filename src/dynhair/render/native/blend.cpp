// Tiles [first, last): blends their splats front to back.
//
// CHANNELS        feature channels rounded up to the width this kernel was compiled for
// splats, starts, entries   as written by project.cpp and bin.cpp
// reached         (entries,) u16: for the backward, the blocks of the tile to which an entry contributed
// ends            (tiles,): one past the last entry looked at; behind it the tile is opaque
// image           (height, width, channels), alpha and depth (height, width)

const int tiles_x = (width + TILE - 1) / TILE;
constexpr int STRIDE = FEATURES + CHANNELS;
const Vec one = Simd::splat(1.0f);

for (int tile = first; tile < last; ++tile) {
    const int left = tile % tiles_x * TILE, top = tile / tiles_x * TILE;
    alignas(64) float transmittance[16][16];     // by block; its sign says whether a pixel is still open
    alignas(64) float sums[16][1 + CHANNELS][16];  // depth, then features
    unsigned open = 0;
    for (int block = 0; block < 16; ++block) {
        const Vec x = COLUMN + (float)(left + (block & 3) * BLOCK), y = ROW + (float)(top + (block >> 2) * BLOCK);
        const Lanes inside = (x < (float)width) & (y < (float)height);
        Simd::store(transmittance[block], Simd::select(inside, one, -one));
        if (Simd::bits(inside)) open |= 1u << block;
        for (int c = 0; c <= CHANNELS; ++c) Simd::store(sums[block][c], Vec{});
    }

    const int end = starts[tile + 1];
    int entry = starts[tile];
    for (; entry < end && open; ++entry) {
        const float* s = splats + (i64)entries[entry] * STRIDE;
        if (entry + 6 < end) {
            const float* coming = splats + (i64)entries[entry + 6] * STRIDE;
            for (int k = 0; k < STRIDE; k += 16) __builtin_prefetch(coming + k);
        }
        unsigned contributed = 0;
        for (unsigned blocks = reached_cells(s, left, top, BLOCK) & open; blocks; blocks &= blocks - 1) {
            const int block = __builtin_ctz(blocks);
            const Vec t = Simd::load(transmittance[block]);
            Vec log2_alpha, dx, dy;
            evaluate(s, left, top, block, dx, dy, log2_alpha);
            const Lanes hit = (log2_alpha >= LOG2_ALPHA_MIN) & (t > 0.0f);
            if (!Simd::bits(hit)) continue;
            const Vec alpha = Simd::keep(hit, Simd::min(Simd::exp2(Simd::min(log2_alpha, one)), Simd::splat(ALPHA_MAX)));
            Vec weight = alpha * t;
            Vec rest = Simd::fma(-alpha, t, t);
            const Lanes closing = hit & (rest <= TRANSMITTANCE_MIN);
            if (__builtin_expect(Simd::bits(closing), 0)) {
                close(closing, t, weight, rest);
                if (!Simd::bits(rest > 0.0f)) open &= ~(1u << block);
            }
            Simd::store(transmittance[block], rest);
            contributed |= 1u << block;
#pragma unroll
            for (int c = 0; c <= CHANNELS; ++c)
                Simd::store(sums[block][c], Simd::fma(weight, Simd::splat(s[DEPTH + c]), Simd::load(sums[block][c])));
        }
        reached[entry] = contributed;
    }
    ends[tile] = entry;

    for (int block = 0; block < 16; ++block)
        for (int l = 0; l < 16; ++l) {
            const int x = left + (block & 3) * BLOCK + (l & 3), y = top + (block >> 2) * BLOCK + (l >> 2);
            if (x >= width || y >= height) continue;
            const i64 pixel = (i64)y * width + x;
            const float covered = 1.0f - __builtin_fabsf(transmittance[block][l]);
            alpha[pixel] = covered;
            depth[pixel] = covered > 0.0f ? sums[block][0][l] / covered : 0.0f;
            for (int c = 0; c < channels; ++c) image[pixel * channels + c] = sums[block][1 + c][l];
        }
}
