// Gaussians [first, last) -> splats, the tiles each of them reaches, and keys to sort the visible ones by depth.
//
// camera          see geometry.cpp
// means, quats, scales, opacities, features (n, channels)
// splats          (n, stride), written for the visible
// bounds          (n, 4) u16: first and last + 1 tile in x, then in y; empty where not visible
// masks           (n,) u16: the tiles reached, counted from the first, where the bounds are at most 4 x 4 tiles
// keys            (last - first,) u64 from `first` on: depth in the high half, index in the low, visible ones packed
// counts          (tiles + columns + 2,): how many splats reach each tile, then some room, at the end the visible

u64* key = keys + first;
int visible_count = 0;
const float cx = camera[14], cy = camera[15];
const float infinity = __builtin_inff();

// Tile that holds a pixel coordinate, clamped to [0, limit].
auto to_tile = [](float pixel, int limit) -> int {
    const float tile = pixel * (1.0f / TILE);
    return tile <= 0.0f ? 0 : tile >= (float)limit ? limit : (int)tile;
};

// Copies numbers and says whether all of them are finite.
auto copy_finite = [](const float* from, int count, float* to) -> bool {
    typedef unsigned Quad __attribute__((ext_vector_type(4), aligned(4)));
    const unsigned exponent = 0x7f800000;
    int invalid = 0, c = 0;
    for (; c + 4 <= count; c += 4) {
        const Quad four = *(const Quad*)(from + c);
        *(Quad*)(to + c) = four;
        invalid |= __builtin_reduce_or((four & exponent) == exponent);
    }
    for (; c < count; ++c) {
        to[c] = from[c];
        invalid |= (__builtin_bit_cast(unsigned, from[c]) & exponent) == exponent;
    }
    return !invalid;
};

// Counts the tiles of a mask whose first is `corner`. Most boxes have at most 2 x 2 tiles: to add for all four, be it
// zero, costs less than a loop of unpredictable length.
auto count_tiles = [=](unsigned mask, int corner) {
    if (mask & ~0x33u) {
        for (; mask; mask &= mask - 1) {
            const int cell = __builtin_ctz(mask);
            ++counts[corner + (cell >> 2) * tiles_x + (cell & 3)];
        }
        return;
    }
    counts[corner] += mask & 1;
    counts[corner + 1] += mask >> 1 & 1;
    counts[corner + tiles_x] += mask >> 4 & 1;
    counts[corner + tiles_x + 1] += mask >> 5 & 1;
};

for (int base = first; base < last; base += 16) {
    const int count = last - base < 16 ? last - base : 16;
    Projection p;
    p.project(camera, means + (i64)3 * base, quats + (i64)4 * base, scales + (i64)3 * base, count);
    Vec opacity;
    Projection::gather(opacities + base, 1, count, &opacity);
    opacity *= Simd::sqrt(p.own_det * p.inverse_det);  // dilated, it covers more: it is made as much fainter

    const Vec log2_opacity = Simd::log2(Simd::max(opacity, 1e-6f));
    const Vec reach = Simd::sqrt(2.0f / LOG2_E * Simd::max(log2_opacity - LOG2_ALPHA_MIN, 0.0f));  // in sigmas
    const Vec x = p.x * p.inverse_z * camera[12] + cx, y = p.y * p.inverse_z * camera[13] + cy;
    const Vec reach_x = reach * Simd::sqrt(p.cov_xx), reach_y = reach * Simd::sqrt(p.cov_yy);
    const Vec to_exponent = -0.5f * LOG2_E * p.inverse_det;
    // Comparisons are false for NaN, so this also drops what is not finite.
    const Lanes visible = (p.z > NEAR) & (opacity >= 1.0f / 255) & (opacity < infinity) & (p.inverse_det > 0.0f) &
                          (x + reach_x > 0.5f) & (x - reach_x < width - 0.5f) &
                          (y + reach_y > 0.5f) & (y - reach_y < height - 0.5f) &
                          (p.z + reach_x + reach_y < infinity);

    alignas(64) float lanes[8][16], box[4][16];
    Simd::store(lanes[X], x);
    Simd::store(lanes[Y], y);
    Simd::store(lanes[XX], to_exponent * p.cov_yy);
    Simd::store(lanes[XY], to_exponent * p.cov_xy * -2.0f);
    Simd::store(lanes[YY], to_exponent * p.cov_xx);
    Simd::store(lanes[LOG2_OPACITY], log2_opacity);
    Simd::store(lanes[UNUSED], 0.0f);
    Simd::store(lanes[DEPTH], p.z);
    Simd::store(box[0], x - reach_x - 0.5f);
    Simd::store(box[1], x + reach_x - 0.5f);
    Simd::store(box[2], y - reach_y - 0.5f);
    Simd::store(box[3], y + reach_y - 0.5f);
    const unsigned visible_bits = Simd::bits(visible);

    for (int l = 0; l < count; ++l) {
        const i64 i = base + l;
        u16* tiles = bounds + 4 * i;
        tiles[0] = tiles[1] = tiles[2] = tiles[3] = 0;
        if (!(visible_bits >> l & 1)) continue;

        float* splat = splats + i * stride;
        for (int k = 0; k < FEATURES; ++k) splat[k] = lanes[k][l];
        if (!copy_finite(features + i * channels, channels, splat + FEATURES)) continue;
        for (int c = FEATURES + channels; c < stride; ++c) splat[c] = 0.0f;

        const int x0 = to_tile(box[0][l], tiles_x), x1 = to_tile(box[1][l] + TILE, tiles_x);
        const int y0 = to_tile(box[2][l], tiles_y), y1 = to_tile(box[3][l] + TILE, tiles_y);
        if (x0 >= x1 || y0 >= y1) continue;
        masks[i] = reached_tiles(splat, x0, x1, y0, y1);
        unsigned any = 0;
        visit_tiles(splat, x0, x1, y0, y1, masks[i], [&](unsigned mask, int tx, int ty) {
            any |= mask;
            count_tiles(mask, ty * tiles_x + tx);
        });
        if (!any) continue;
        tiles[0] = x0, tiles[1] = x1, tiles[2] = y0, tiles[3] = y1;
        unsigned depth_bits;  // the bits of positive floats sort like the floats
        __builtin_memcpy(&depth_bits, splat + DEPTH, 4);
        *key++ = (u64)depth_bits << 32 | (unsigned)i;
        ++visible_count;
    }
}
counts[tiles_x * tiles_y + tiles_x + 1] = visible_count;
