// Which tiles a splat reaches.

const int tiles_x = (width + TILE - 1) / TILE, tiles_y = (height + TILE - 1) / TILE;

// The tiles of the box [x0, x1) x [y0, y1), of at most 4 x 4, that a splat reaches.
auto reached_tiles = [=](const float* s, int x0, int x1, int y0, int y1) -> unsigned {
    const int columns = x1 - x0 < 4 ? x1 - x0 : 4, rows = y1 - y0 < 4 ? y1 - y0 : 4;
    const unsigned box = (0x1111u * ((1u << columns) - 1)) & ((1u << 4 * rows) - 1);
    return columns * rows == 1 ? box : box & reached_cells(s, x0 * TILE, y0 * TILE, TILE);
};

// Calls visit(mask, x, y) for each 4 x 4 tiles from (x, y) on in a box; `known` is the mask of a box that is no larger.
auto visit_tiles = [=](const float* s, int x0, int x1, int y0, int y1, unsigned known, auto&& visit) {
    if (x1 - x0 <= 4 && y1 - y0 <= 4)
        visit(known, x0, y0);
    else
        for (int y = y0; y < y1; y += 4)
            for (int x = x0; x < x1; x += 4) visit(reached_tiles(s, x, x1, y, y1), x, y);
};
