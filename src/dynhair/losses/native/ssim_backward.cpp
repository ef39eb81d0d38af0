// Gradient of the sum of all similarities with respect to the image: rows [first, last) of all images.
//
// image, target, weights, of_mean, of_square, of_product   as for ssim.cpp
// columns         (3 * ((width + 10) * channels + 32),): noughts; scratch, the derivatives blurred along the columns
//                 with noughts on both sides
// gradient        (n, height, width, channels)

typedef float Vec __attribute__((ext_vector_type(16)));
typedef float Loose __attribute__((ext_vector_type(16), aligned(4)));
typedef long long i64;
constexpr int WINDOW = 11, DERIVATIVES = 3;
const int row = width * channels, kept = (width - WINDOW + 1) * channels, rows = height - WINDOW + 1;
const int margin = (WINDOW - 1) * channels, room = margin + row + 32;
auto load = [](const float* from, int count) -> Vec {
    if (count >= 16) return *(const Loose*)from;
    Vec values = 0.0f;
    for (int l = 0; l < count; ++l) values[l] = from[l];
    return values;
};
const float* const derivatives[DERIVATIVES] = {of_mean, of_square, of_product};
for (int job = first; job < last; ++job) {
    const int y = job % height;
    const i64 map = (i64)(job / height) * rows, at = (i64)job * row;
    const int top = y < rows ? y : rows - 1, bottom = y - WINDOW + 1 > 0 ? y - WINDOW + 1 : 0;
    for (int d = 0; d < DERIVATIVES; ++d)
        for (int x = 0; x < kept; x += 16) {
            Vec sum = 0.0f;
            for (int r = bottom; r <= top; ++r)
                sum += weights[y - r] * load(derivatives[d] + (map + r) * kept + x, kept - x);
            *(Loose*)(columns + d * room + margin + x) = sum;
        }
    for (int x = 0; x < row; x += 16) {
        Vec sums[DERIVATIVES];
        for (int d = 0; d < DERIVATIVES; ++d) {
            sums[d] = 0.0f;
            for (int k = 0; k < WINDOW; ++k)
                sums[d] += weights[k] * *(const Loose*)(columns + d * room + margin + x - k * channels);
        }
        const int count = row - x;
        const Vec a = load(image + at + x, count), b = load(target + at + x, count);
        const Vec values = sums[0] + 2.0f * a * sums[1] + b * sums[2];
        if (count >= 16) *(Loose*)(gradient + at + x) = values;
        else
            for (int l = 0; l < count; ++l) gradient[at + x + l] = values[l];
    }
}
