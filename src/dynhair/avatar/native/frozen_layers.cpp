// Points [first, last) through leaky-ReLU layers, none after the last.
//
// CHANNELS        the widest layer's outputs, rounded up to 16
// sizes           (layers, 3): inputs, outputs, and which of the points' own terms is added: 0 none, 1 given, 2 again
// points          (n, inputs of the first layer)
// weights         (inputs, outputs) of all layers, one after the other; the outputs of a layer are rounded up to 16 wherever
//                 they lie. A last layer of at most THIN outputs is laid out as (outputs, inputs rounded up to 16)
// biases          of all layers
// given, again    (n, outputs) of the layers that they are added to
// outputs         (n, outputs)

typedef float Vec __attribute__((ext_vector_type(16)));
typedef float Loose __attribute__((ext_vector_type(16), aligned(4)));  // anywhere in memory
typedef long long i64;
constexpr float SLOPE = 0.01f;
constexpr int THIN = 4;
#ifdef __AVX512F__
constexpr int ROWS = 8;  // points at a time: with two vectors each, as many sums as registers hold beside the weights
#else
constexpr int ROWS = 2;
#endif
struct One { enum { COUNT = 1 }; };
struct Two { enum { COUNT = 2 }; };
auto rounded = [](int width) { return (width + 15) / 16 * 16; };

typedef float Row[CHANNELS];
alignas(64) Row values[2][ROWS];
for (int base = first; base < last; base += ROWS) {
    const int some = last - base < ROWS ? last - base : ROWS;
    auto row = [=](int r) -> i64 { return base + (r < some ? r : some - 1); };  // rows past the end repeat the last one
    int now = 0;
    for (int r = 0; r < ROWS; ++r)
        for (int k = 0; k < rounded(sizes[0]); ++k) values[0][r][k] = k < sizes[0] ? points[row(r) * sizes[0] + k] : 0.0f;

    const float *w = weights, *bias = biases;
    for (int l = 0; l < layers; ++l) {
        const int in = sizes[3 * l], out = sizes[3 * l + 1], width = rounded(out);
        const float* own = sizes[3 * l + 2] == 1 ? given : sizes[3 * l + 2] == 2 ? again : nullptr;
        Row *x = values[now], *y = values[now ^ 1];
        if (l + 1 == layers && out <= THIN) {
            for (int r = 0; r < some; ++r)
                for (int o = 0; o < out; ++o) {
                    Vec sum = 0.0f;
                    for (int k = 0; k < in; k += 16)
                        sum += *(const Vec*)(x[r] + k) * *(const Loose*)(w + o * rounded(in) + k);
                    const auto eight = sum.lo + sum.hi;
                    const auto four = eight.lo + eight.hi;
                    const float total = (four[0] + four[1]) + (four[2] + four[3]) + bias[o];
                    outputs[(base + r) * (i64)out + o] = own ? total + own[row(r) * width + o] : total;
                }
            break;
        }
        auto columns = [&](auto vectors, int o) {
            constexpr int COUNT = decltype(vectors)::COUNT;
            Vec sums[ROWS][COUNT];
            for (int r = 0; r < ROWS; ++r)
                for (int v = 0; v < COUNT; ++v) {
                    sums[r][v] = *(const Loose*)(bias + o + 16 * v);
                    if (own) sums[r][v] += *(const Loose*)(own + row(r) * width + o + 16 * v);
                }
            for (int k = 0; k < in; ++k) {
                Vec factors[COUNT];
#pragma unroll
                for (int v = 0; v < COUNT; ++v) factors[v] = *(const Loose*)(w + (i64)k * width + o + 16 * v);
#pragma unroll
                for (int r = 0; r < ROWS; ++r)
#pragma unroll
                    for (int v = 0; v < COUNT; ++v) sums[r][v] += factors[v] * x[r][k];
            }
            for (int r = 0; r < ROWS; ++r)
                for (int v = 0; v < COUNT; ++v) {
                    const Vec sum = sums[r][v];
                    *(Vec*)(y[r] + o + 16 * v) = l + 1 < layers ? __builtin_elementwise_max(sum, SLOPE * sum) : sum;
                }
        };
        int o = 0;
        for (; o + 32 <= width; o += 32) columns(Two{}, o);
        if (o < width) columns(One{}, o);
        w += (i64)in * width;
        bias += width;
        now ^= 1;
        if (l + 1 == layers)
            for (int r = 0; r < some; ++r)
                for (int c = 0; c < out; ++c) outputs[(base + r) * (i64)out + c] = y[r][c];
    }
}
