// Structural similarity around the pixels whose 11 x 11 windows lie in the image, and its derivatives.
//
// A job is one row of one image's map, counted through all images: jobs [first, last).
//
// image, target   (n, height, width, channels), rows taken as they lie: a pixel's neighbour is `channels` floats on
// weights         (11,): the window along one axis
// columns         (4 * (width * channels + 32),): scratch, the moments blurred along the columns
// sums            (n * (height - 10),): the similarities of each row of the map, added up
// of_mean, of_square, of_product   where `differentiate` is set, (n, height - 10, (width - 10) * channels): derivatives
//                 of each similarity with respect to the blurred image, squares (of both, together) and products

typedef float Vec __attribute__((ext_vector_type(16)));
typedef float Loose __attribute__((ext_vector_type(16), aligned(4)));  // anywhere in memory
typedef long long i64;
constexpr int WINDOW = 11, MOMENTS = 4;
constexpr float C1 = 0.01f * 0.01f, C2 = 0.03f * 0.03f;
const int row = width * channels, kept = (width - WINDOW + 1) * channels, rows = height - WINDOW + 1;
const int room = row + 32;
auto load = [](const float* from, int count) -> Vec {
    if (count >= 16) return *(const Loose*)from;
    Vec values = 0.0f;
    for (int l = 0; l < count; ++l) values[l] = from[l];
    return values;
};
auto save = [](Vec values, int count, float* to) {
    if (count >= 16) *(Loose*)to = values;
    else
        for (int l = 0; l < count; ++l) to[l] = values[l];
};
for (int job = first; job < last; ++job) {
    const i64 above = ((i64)(job / rows) * height + job % rows) * row;
    for (int x = 0; x < row; x += 16) {
        Vec mean = 0.0f, target_mean = 0.0f, square = 0.0f, product = 0.0f;
        for (int k = 0; k < WINDOW; ++k) {
            const Vec a = load(image + above + k * row + x, row - x), b = load(target + above + k * row + x, row - x);
            const Vec wa = weights[k] * a, wb = weights[k] * b;
            mean += wa;
            target_mean += wb;
            square += wa * a + wb * b;
            product += wa * b;
        }
        *(Loose*)(columns + x) = mean;
        *(Loose*)(columns + room + x) = target_mean;
        *(Loose*)(columns + 2 * room + x) = square;
        *(Loose*)(columns + 3 * room + x) = product;
    }
    Vec total = 0.0f;
    for (int x = 0; x < kept; x += 16) {
        Vec moments[MOMENTS];
        for (int m = 0; m < MOMENTS; ++m) {
            moments[m] = 0.0f;
            for (int k = 0; k < WINDOW; ++k)
                moments[m] += weights[k] * *(const Loose*)(columns + m * room + x + k * channels);
        }
        const Vec mean = moments[0], target_mean = moments[1], square = moments[2], product = moments[3];
        const Vec mean_product = mean * target_mean, mean_square = mean * mean + target_mean * target_mean;
        const Vec below = 1.0f / (mean_square + C1), spread_below = 1.0f / (square - mean_square + C2);
        const Vec luminance = (2.0f * mean_product + C1) * below;
        const Vec structure = (2.0f * (product - mean_product) + C2) * spread_below;
        Vec similarity = luminance * structure;
        for (int l = kept - x; l < 16; ++l) similarity[l] = 0.0f;
        total += similarity;
        if (differentiate) {
            const i64 at = (i64)job * kept + x;
            const Vec by_luminance = structure * below, by_structure = luminance * spread_below;
            save(2.0f * (by_luminance * (target_mean - luminance * mean) + by_structure * (structure * mean - target_mean)),
                 kept - x, of_mean + at);
            save(-by_structure * structure, kept - x, of_square + at);
            save(2.0f * by_structure, kept - x, of_product + at);
        }
    }
    float sum = 0.0f;
    for (int l = 0; l < 16; ++l) sum += total[l];
    sums[job] = sum;
}
