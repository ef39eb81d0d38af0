// Shared by every kernel: 16-lane vectors, and what a projected Gaussian ("splat") looks like in memory.
//
// Each file in this folder is pasted into the body of one function, this one in front of it, so the helpers are static
// members of local structs. Vector extensions rather than intrinsics: they compile to AVX-512, AVX2 or NEON alike.

typedef float Vec __attribute__((ext_vector_type(16)));
typedef int Lanes __attribute__((ext_vector_type(16)));  // per-lane truth: 0 or -1
typedef bool Bits __attribute__((ext_vector_type(16)));
typedef unsigned short u16;
typedef long long i64;  // `long` has 32 bits on Windows
typedef unsigned long long u64;

constexpr int TILE = 16;                    // pixels on the side of a tile
constexpr int BLOCK = 4;                    // pixels on the side of a block; a vector holds one block
constexpr float DILATION = 0.3f;            // px^2 added to both variances (3DGS, low-pass filter)
constexpr float NEAR = 0.01f;               // metres
constexpr float ALPHA_MAX = 0.999f;
constexpr float LOG2_ALPHA_MIN = -7.99435343686f;  // log2(1/255)
constexpr float TRANSMITTANCE_MIN = 1e-4f;
constexpr float LOG2_E = 1.44269504089f;

// A splat is `stride` floats: this header, then one float for each feature channel. Over a splat's footprint
//   log2(alpha) = xx dx^2 + xy dx dy + yy dy^2 + log2_opacity.
// Depth stands just before the features so that it is blended as channel 0.
enum Field { X, Y, XX, XY, YY, LOG2_OPACITY, UNUSED, DEPTH, FEATURES };

struct Simd {
    static inline Vec load(const float* p) { return *(const Vec*)p; }  // aligned, like all that is on the stack
    static inline void store(float* p, Vec v) { *(Vec*)p = v; }
    static inline Vec fma(Vec a, Vec b, Vec c)
    {
#if defined(__FMA__) || defined(__aarch64__)
        return __builtin_elementwise_fma(a, b, c);
#else
        return a * b + c;  // a library call for each lane would stand in for the missing instruction
#endif
    }
    static inline Vec min(Vec a, Vec b) { return a < b ? a : b; }  // one instruction, unlike one that heeds NaN
    static inline Vec max(Vec a, Vec b) { return a > b ? a : b; }
    static inline Vec clamp(Vec x, Vec low, Vec high) { return min(max(x, low), high); }
    static inline Vec sqrt(Vec x) { return __builtin_elementwise_sqrt(x); }
    static inline Vec keep(Lanes where, Vec x) { return where ? x : (Vec)0.0f; }
    static inline unsigned bits(Lanes where)
    {
        const Bits lanes = __builtin_convertvector(where, Bits);
        u16 result;
        __builtin_memcpy(&result, &lanes, sizeof result);
        return result;
    }

    // log2 of a positive normal number, by the series of the inverse hyperbolic tangent.
    static inline Vec log2(Vec x)
    {
        const int SQRT_HALF = 0x3f3504f3;
        const Lanes exponent = (__builtin_bit_cast(Lanes, x) - SQRT_HALF) >> 23;
        const Vec m = __builtin_bit_cast(Vec, __builtin_bit_cast(Lanes, x) - (exponent << 23));  // about 1
        const Vec s = (m - 1.0f) / (m + 1.0f), s2 = s * s;
        const Vec series = s * (2.0f + s2 * (2.0f / 3 + s2 * (2.0f / 5 + s2 * (2.0f / 7 + s2 * (2.0f / 9)))));
        return __builtin_convertvector(exponent, Vec) + series * LOG2_E;
    }
};

const Vec COLUMN = {0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3};
const Vec ROW = {0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 2, 3, 3, 3, 3};

// Which cells of a 4 x 4 grid a splat reaches with alpha >= 1/255; bit 4 * row + column. A cell is `size` pixels wide
// and the grid's first pixel is (left, top). Exact but for a small margin: the largest value of a concave quadratic over
// a box lies at its peak or on one of the two sides that face the peak.
auto reached_cells = [=](const float* s, float left, float top, float size) -> unsigned {
    const float xx = s[XX], xy = s[XY], yy = s[YY];
    const Vec x0 = COLUMN * size + (left + 0.5f - s[X]), x1 = x0 + (size - 1.0f);
    const Vec y0 = ROW * size + (top + 0.5f - s[Y]), y1 = y0 + (size - 1.0f);
    const Vec near_x = Simd::clamp(0.0f, x0, x1), near_y = Simd::clamp(0.0f, y0, y1);
    const Vec y = Simd::clamp(near_x * (-0.5f * xy / yy), y0, y1);  // best on the side that faces in x
    const Vec x = Simd::clamp(near_y * (-0.5f * xy / xx), x0, x1);  // best on the side that faces in y
    const Vec a = near_x * (near_x * xx + y * xy) + y * (y * yy);
    const Vec b = x * (x * xx + near_y * xy) + near_y * (near_y * yy);
    const float margin = 0.01f;
    return Simd::bits(Simd::max(a, b) >= LOG2_ALPHA_MIN - margin - s[LOG2_OPACITY]);
};
