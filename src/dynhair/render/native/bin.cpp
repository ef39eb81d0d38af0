// Visible splats in order of depth -> for each tile the list of those that reach it, front to back.
//
// splats, bounds, masks   as written by project.cpp
// keys            (n,) u64, `visible` of them from the start on; sorted on return
// spare           (n,) u64 scratch
// starts          (tiles + 1,): where each tile's list starts
// entries         (starts[tiles],): the lists
// cursors         (tiles,) scratch

const int tiles_x = (width + TILE - 1) / TILE, tiles = tiles_x * ((height + TILE - 1) / TILE);

// Stable radix sort of the depths, three digits of 11 bits. Its passes are odd in number: it starts in `keys`.
const int DIGITS = 3, BUCKETS = 2048;
int histogram[DIGITS][BUCKETS];
u64 *from = keys, *to = spare;
for (int d = 0; d < DIGITS; ++d)
    for (int b = 0; b < BUCKETS; ++b) histogram[d][b] = 0;
for (int i = 0; i < visible; ++i)
    for (int d = 0; d < DIGITS; ++d) ++histogram[d][from[i] >> (32 + 11 * d) & (BUCKETS - 1)];
for (int d = 0; d < DIGITS; ++d) {
    int sum = 0;
    for (int b = 0; b < BUCKETS; ++b) {
        const int size = histogram[d][b];
        histogram[d][b] = sum;
        sum += size;
    }
    for (int i = 0; i < visible; ++i) to[histogram[d][from[i] >> (32 + 11 * d) & (BUCKETS - 1)]++] = from[i];
    u64* swapped = from;
    from = to;
    to = swapped;
}

int* cursor = cursors;
for (int t = 0; t < tiles; ++t) cursor[t] = starts[t];
for (int k = 0; k < visible; ++k) {
    if (k + 16 < visible) __builtin_prefetch(bounds + (i64)4 * (unsigned)from[k + 16]);
    const unsigned i = (unsigned)from[k];
    const u16* b = bounds + (i64)4 * i;
    const bool whole = b[1] - b[0] <= 4 && b[3] - b[2] <= 4;
    for (int ty = b[2]; ty < b[3]; ty += 4)
        for (int tx = b[0]; tx < b[1]; tx += 4) {
            unsigned mask = masks[i];
            if (!whole) {
                const int columns = b[1] - tx < 4 ? b[1] - tx : 4, rows = b[3] - ty < 4 ? b[3] - ty : 4;
                mask = (0x1111u * ((1u << columns) - 1)) & ((1u << 4 * rows) - 1);
                if (columns * rows > 1) mask &= reached_cells(splats + (i64)i * stride, tx * TILE, ty * TILE, TILE);
            }
            for (; mask; mask &= mask - 1) {
                const int cell = __builtin_ctz(mask);
                entries[cursor[(ty + (cell >> 2)) * tiles_x + tx + (cell & 3)]++] = i;
            }
        }
}
