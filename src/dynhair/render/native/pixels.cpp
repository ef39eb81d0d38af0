// What the blend's forward and backward must compute alike, to the bit.

const float EXP2_SERIES[] = {1.327647129e-3f, 9.675540961e-3f, 5.550713092e-2f, 2.402212024e-1f, 6.931469440e-1f, 1.0f};

// The tile being drawn: its pixel centres, block by block.
struct Pixels {
    alignas(64) float x[16][16], y[16][16];
    const float* exp2_series;

    inline Pixels() : exp2_series(nullptr) {}

    inline void enter(int left, int top, const float* series)
    {
        for (int block = 0; block < 16; ++block)
            for (int l = 0; l < 16; ++l) {
                x[block][l] = left + (block & 3) * BLOCK + (l & 3) + 0.5f;
                y[block][l] = top + (block >> 2) * BLOCK + (l >> 2) + 0.5f;
            }
        // Hide where the numbers come from: code that may be loaded at any address would otherwise build the address
        // of each constant anew at every use.
        exp2_series = series;
        asm("" : "+r"(exp2_series));
    }

    // 2^x for x in [-126, 127], relative error below 2e-7. Adding 1.5 * 2^23 rounds to an integer and leaves it in the
    // low bits, from where it is shifted into the exponent.
    inline Vec exp2(Vec x) const
    {
        const float SHIFT = 12582912.0f;
        const Vec shifted = x + SHIFT, f = x - (shifted - SHIFT);
        Vec p = exp2_series[0];
#pragma unroll
        for (int k = 1; k < 6; ++k) p = Simd::fma(p, f, exp2_series[k]);
        return __builtin_bit_cast(Vec, __builtin_bit_cast(Lanes, p) + (__builtin_bit_cast(Lanes, shifted) << 23));
    }
};
Pixels pixels;

// One splat on one block. `t` is the transmittance before it, 0 where a pixel is finished. A pixel that the splat would
// make opaque is finished without it (3DGS).
struct Coverage {
    Vec dx, dy, raw, alpha, weight, after;
    Lanes open;  // pixels not finished

    inline Coverage(const Pixels& pixels, const float* s, int block, Vec t)
    {
        dx = Simd::load(pixels.x[block]) - s[X];
        dy = Simd::load(pixels.y[block]) - s[Y];
        const Vec inner = Simd::fma(dx, s[XX], dy * s[XY]);
        const Vec log2_alpha = Simd::fma(dx, inner, Simd::fma(dy * s[YY], dy, s[LOG2_OPACITY]));
        raw = pixels.exp2(log2_alpha);
        alpha = Simd::keep(log2_alpha >= LOG2_ALPHA_MIN, Simd::min(raw, ALPHA_MAX));
        const Vec rest = Simd::fma(-alpha, t, t);
        open = rest > TRANSMITTANCE_MIN;
        weight = Simd::keep(open, alpha * t);
        after = Simd::keep(open, rest);
    }
};
