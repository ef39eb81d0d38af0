// Tiles [first, last): blends their splats front to back.
//
// CHANNELS        feature channels rounded up to the width this kernel was compiled for
// splats, starts, entries   as written by project.cpp and bin.cpp
// reached         (entries,) u16: for the backward, the blocks of the tile to which an entry contributed
// ends            (tiles,): one past the last entry looked at; behind it the tile is opaque
// image           (height, width, channels), alpha and depth (height, width)

constexpr int STRIDE = FEATURES + CHANNELS, BATCH = 64, AHEAD = 16;
typedef u16 BatchMasks __attribute__((ext_vector_type(BATCH)));
typedef bool BatchBits __attribute__((ext_vector_type(BATCH)));
const int tiles_x = (width + TILE - 1) / TILE;

for (int tile = first; tile < last; ++tile) {
    const int left = tile % tiles_x * TILE, top = tile / tiles_x * TILE;
    pixels.enter(left, top, EXP2_SERIES);
    alignas(64) float transmittance[16][16];       // by block; 0 where a pixel is finished
    alignas(64) float covered[16][16];             // sums of the weights
    alignas(64) float sums[16][1 + CHANNELS][16];  // depth, then features
    unsigned open = 0;                             // blocks with a pixel that is not finished
    for (int block = 0; block < 16; ++block) {
        const Lanes inside = (Simd::load(pixels.x[block]) < (float)width) & (Simd::load(pixels.y[block]) < (float)height);
        Simd::store(transmittance[block], Simd::keep(inside, 1.0f));
        Simd::store(covered[block], 0.0f);
        if (Simd::bits(inside)) open |= 1u << block;
        for (int c = 0; c <= CHANNELS; ++c) Simd::store(sums[block][c], 0.0f);
    }

    // A batch of entries is first sorted out by block; then a block's sums stay in registers for the whole batch.
    const int end = starts[tile + 1];
    int start = starts[tile];
    for (; start < end && open; start += BATCH) {
        const int count = end - start < BATCH ? end - start : BATCH;
        alignas(128) u16 masks[BATCH] = {}, hits[BATCH] = {};
        for (int k = 0; k < count; ++k) {
            if (start + k + AHEAD < end) {
                const float* coming = splats + (i64)entries[start + k + AHEAD] * STRIDE;
                for (int line = 0; line < STRIDE; line += 16) __builtin_prefetch(coming + line);
            }
            masks[k] = reached_cells(splats + (i64)entries[start + k] * STRIDE, left, top, BLOCK) & open;
        }
        for (unsigned blocks = open; blocks; blocks &= blocks - 1) {
            const int block = __builtin_ctz(blocks);
            const BatchMasks of_block = *(const BatchMasks*)masks & (u16)(1u << block);
            const BatchBits lanes = __builtin_convertvector(of_block, BatchBits);
            u64 batch;
            __builtin_memcpy(&batch, &lanes, sizeof batch);
            if (!batch) continue;
            Vec t = Simd::load(transmittance[block]), cover = Simd::load(covered[block]), sum[1 + CHANNELS];
#pragma unroll
            for (int c = 0; c <= CHANNELS; ++c) sum[c] = Simd::load(sums[block][c]);
            for (; batch; batch &= batch - 1) {
                const int k = __builtin_ctzll(batch);
                const float* s = splats + (i64)entries[start + k] * STRIDE;
                const Coverage coverage(pixels, s, block, t);
                t = coverage.after;
                cover += coverage.weight;
                hits[k] |= (Simd::bits(coverage.weight > 0.0f) != 0) << block;
#pragma unroll
                for (int c = 0; c <= CHANNELS; ++c) sum[c] = Simd::fma(coverage.weight, s[DEPTH + c], sum[c]);
                if (!Simd::bits(coverage.open)) {
                    open &= ~(1u << block);
                    break;
                }
            }
            Simd::store(transmittance[block], t);
            Simd::store(covered[block], cover);
#pragma unroll
            for (int c = 0; c <= CHANNELS; ++c) Simd::store(sums[block][c], sum[c]);
        }
        for (int k = 0; k < count; ++k) reached[start + k] = hits[k];
    }
    ends[tile] = start < end ? start : end;

    for (int block = 0; block < 16; ++block)
        for (int l = 0; l < 16; ++l) {
            const int x = left + (block & 3) * BLOCK + (l & 3), y = top + (block >> 2) * BLOCK + (l >> 2);
            if (x >= width || y >= height) continue;
            const i64 pixel = (i64)y * width + x;
            const float cover = covered[block][l];
            alpha[pixel] = cover;
            depth[pixel] = cover > 0.0f ? sums[block][0][l] / cover : 0.0f;
            for (int c = 0; c < channels; ++c) image[pixel * channels + c] = sums[block][1 + c][l];
        }
}
