// Visible splats in order of depth -> for each tile the list of those that reach it, front to back.
//
// splats, bounds, masks   as written by project.cpp
// keys            (visible,) u64, as written by project.cpp; in disorder on return, like `spare` of the same size
// starts          (tiles + 1,): where each tile's list starts
// entries         (starts[tiles],): the lists
// cursors         (tiles,) scratch

const int tiles = tiles_x * tiles_y;

// Stable radix sort by depth, 11 bits at a time, of only as many bits as the depths' range takes.
constexpr int DIGIT = 11, BUCKETS = 1 << DIGIT, MOST_DIGITS = 3;
unsigned lowest = ~0u, highest = 0;
for (int i = 0; i < visible; ++i) {
    const unsigned depth = keys[i] >> 32;
    lowest = depth < lowest ? depth : lowest;
    highest = depth > highest ? depth : highest;
}
int digits = 0;
while (digits < MOST_DIGITS && visible && (highest - lowest) >> (DIGIT * digits)) ++digits;
int histogram[MOST_DIGITS][BUCKETS] = {};
auto digit_of = [=](u64 key, int digit) -> unsigned {
    return ((unsigned)(key >> 32) - lowest) >> (DIGIT * digit) & (BUCKETS - 1);
};
for (int i = 0; i < visible; ++i)
    for (int d = 0; d < digits; ++d) ++histogram[d][digit_of(keys[i], d)];
u64 *from = keys, *to = spare;
for (int d = 0; d < digits; ++d) {
    int sum = 0;
    for (int b = 0; b < BUCKETS; ++b) {
        const int size = histogram[d][b];
        histogram[d][b] = sum;
        sum += size;
    }
    for (int i = 0; i < visible; ++i) to[histogram[d][digit_of(from[i], d)]++] = from[i];
    u64* swapped = from;
    from = to;
    to = swapped;
}

for (int t = 0; t < tiles; ++t) cursors[t] = starts[t];
for (int k = 0; k < visible; ++k) {
    if (k + 16 < visible) {
        __builtin_prefetch(bounds + (i64)4 * (unsigned)from[k + 16]);
        __builtin_prefetch(masks + (unsigned)from[k + 16]);
    }
    const unsigned i = (unsigned)from[k];
    const u16* b = bounds + (i64)4 * i;
    visit_tiles(splats + (i64)i * stride, b[0], b[1], b[2], b[3], masks[i], [&](unsigned mask, int tx, int ty) {
        int* corner = cursors + ty * tiles_x + tx;
        for (; mask; mask &= mask - 1) {
            const int cell = __builtin_ctz(mask);
            entries[corner[(cell >> 2) * tiles_x + (cell & 3)]++] = i;
        }
    });
}
