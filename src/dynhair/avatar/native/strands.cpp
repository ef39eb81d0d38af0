// Shared by both directions: segments of strands, 16 at a time, and the views that they are seen from.

typedef float Vec __attribute__((ext_vector_type(16)));
typedef float Loose __attribute__((ext_vector_type(16), aligned(4)));  // anywhere in memory
typedef int Lanes __attribute__((ext_vector_type(16)));
typedef long long i64;
constexpr int COEFFICIENTS = 16, FEATURES = 7;  // two labels, a doubled angle, a colour
constexpr float NEGLIGIBLE_LENGTH = 1e-6f, END_ON = 1e-3f;  // as in gaussians.py and orientation.py
const int segments = points - 1, total = count * segments;

auto root = [](Vec x) -> Vec { return __builtin_elementwise_sqrt(x); };

// Rows of `width` numbers from and to columns of 16; lanes beyond `some` repeat the last row, and are not written.
auto columns_of = [](const float* rows, int width, int some, Vec* columns) {
    alignas(64) float lanes[FEATURES][16];
    for (int l = 0; l < 16; ++l)
        for (int k = 0; k < width; ++k) lanes[k][l] = rows[(l < some ? l : some - 1) * width + k];
    for (int k = 0; k < width; ++k) columns[k] = *(const Vec*)lanes[k];
};
auto write_rows = [](const Vec* columns, int width, int some, float* rows) {
    alignas(64) float lanes[FEATURES][16];
    for (int k = 0; k < width; ++k) *(Vec*)lanes[k] = columns[k];
    for (int l = 0; l < some; ++l)
        for (int k = 0; k < width; ++k) rows[l * width + k] = lanes[k][l];
};

struct Segments {
    Vec start[3], along[3], length, direction[3], half_cosine, half_sine, sign;

    inline void enter(const Vec* a, const Vec* b)
    {
        Vec squared = NEGLIGIBLE_LENGTH * NEGLIGIBLE_LENGTH;
        for (int c = 0; c < 3; ++c) start[c] = a[c], along[c] = b[c] - a[c], squared += along[c] * along[c];
        length = __builtin_elementwise_sqrt(squared);
        for (int c = 0; c < 3; ++c) direction[c] = along[c] / length;
        const Vec x = direction[0];
        half_cosine = __builtin_elementwise_sqrt(0.5f + 0.5f * __builtin_elementwise_abs(x));
        half_sine = __builtin_elementwise_copysign(0.5f / half_cosine, x);
        sign = x > 0.0f ? (Vec)1.0f : x < 0.0f ? (Vec)-1.0f : (Vec)0.0f;
    }
    inline Vec middle(int c) const { return start[c] + 0.5f * along[c]; }
};

// A view is its rotation, translation, centre, and the ratio of its focal lengths: 16 numbers.
struct Sight {
    const float* view;
    Vec at[3], towards[3], across, down, scale;  // as in projected_orientation

    inline Sight(const float* view, const Segments& s) : view(view)
    {
        for (int r = 0; r < 3; ++r) {
            at[r] = view[9 + r], towards[r] = 0.0f;
            for (int c = 0; c < 3; ++c) {
                at[r] += view[3 * r + c] * s.middle(c);
                towards[r] += view[3 * r + c] * s.direction[c];
            }
        }
        across = towards[0] * at[2] - at[0] * towards[2];
        down = (towards[1] * at[2] - at[1] * towards[2]) * view[15];
        scale = 1.0f / (across * across + down * down +
                        END_ON * END_ON * (at[0] * at[0] + at[1] * at[1] + at[2] * at[2]));
    }
};

// The harmonics of spherical_harmonics.py in the directions from a view's centre.
auto harmonics = [](const float* view, const Segments& s, Vec* basis) {
    Vec d[3], squared = 0.0f;
    for (int c = 0; c < 3; ++c) d[c] = s.middle(c) - view[12 + c], squared += d[c] * d[c];
    const Vec scale = 1.0f / __builtin_elementwise_sqrt(squared);
    const Vec x = d[0] * scale, y = d[1] * scale, z = d[2] * scale, xx = x * x, yy = y * y, zz = z * z;
    basis[0] = 0.28209479177f;
    basis[1] = -0.48860251190f * y;
    basis[2] = 0.48860251190f * z;
    basis[3] = -0.48860251190f * x;
    basis[4] = 1.09254843059f * x * y;
    basis[5] = -1.09254843059f * y * z;
    basis[6] = 0.31539156525f * (3.0f * zz - 1.0f);
    basis[7] = -1.09254843059f * x * z;
    basis[8] = 0.54627421530f * (xx - yy);
    basis[9] = -0.59004358993f * y * (3.0f * xx - yy);
    basis[10] = 2.89061144264f * x * y * z;
    basis[11] = -0.45704579946f * y * (5.0f * zz - 1.0f);
    basis[12] = 0.37317633259f * z * (5.0f * zz - 3.0f);
    basis[13] = -0.45704579946f * x * (5.0f * zz - 1.0f);
    basis[14] = 1.44530572132f * z * (xx - yy);
    basis[15] = -0.59004358993f * x * (xx - 3.0f * yy);
};
