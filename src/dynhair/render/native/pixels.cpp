// What the blend's forward and backward must compute alike, to the bit.

// Offsets of a block's 16 pixel centres from a splat's, and log2(alpha) there.
auto evaluate = [=](const float* s, int left, int top, int block, Vec& dx, Vec& dy, Vec& log2_alpha) {
    dx = COLUMN + ((left + (block & 3) * BLOCK) + 0.5f - s[X]);
    dy = ROW + ((top + (block >> 2) * BLOCK) + 0.5f - s[Y]);
    const Vec inner = Simd::fma(dx, Simd::splat(s[XX]), dy * s[XY]);
    log2_alpha = Simd::fma(dx, inner, Simd::fma(dy * s[YY], dy, Simd::splat(s[LOG2_OPACITY])));
};

// A pixel that the next splat would make opaque is finished without it (3DGS); a negative sign marks it.
auto close = [](Lanes closing, Vec t, Vec& weight, Vec& rest) {
    weight = Simd::keep(~closing, weight);
    rest = Simd::select(closing, -t, rest);
};
