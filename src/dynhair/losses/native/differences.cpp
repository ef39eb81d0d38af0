// Numbers [first, last) of two images: their weighted differences added up, or their gradient.
//
// Differences above nought count slopes[0] times, those below slopes[1] times; where `turns` is set, angles in turns are
// compared, and a difference is that to the nearest of the target and its equals.
//
// predicted, target, weight    one number each; `weight` is read where `weighted` is set
// sum                          sum[part] is written where `back` is not set
// scale, gradient              slopes times weight times scale[0] are written where `back` is set

constexpr int LANES = 16, RUN = 1024;
const float above = slopes[0], below = slopes[1], factor = back ? scale[0] : 1.0f;
double total = 0.0;
for (long long start = first; start < last; start += RUN) {
    float slope[RUN], difference[RUN];
    const int count = last - start < RUN ? (int)(last - start) : RUN;
    for (int i = 0; i < count; ++i) difference[i] = predicted[start + i] - target[start + i];
    if (turns)  // the sum and difference round, halves to even
        for (int i = 0; i < count; ++i) difference[i] -= (difference[i] + 12582912.0f) - 12582912.0f;
    for (int i = 0; i < count; ++i)
        slope[i] = factor * (difference[i] > 0.0f ? above : difference[i] < 0.0f ? -below : 0.0f);
    if (weighted)
        for (int i = 0; i < count; ++i) slope[i] *= weight[start + i];
    if (back) {
        for (int i = 0; i < count; ++i) gradient[start + i] = slope[i];
        continue;
    }
    // lanes, for a compiler must not reorder sums; runs are short, so that adding up in float loses nothing
    float lanes[LANES] = {};
    for (int i = count; i < (count + LANES - 1) / LANES * LANES; ++i) slope[i] = difference[i] = 0.0f;
    for (int i = 0; i < count; i += LANES)
        for (int k = 0; k < LANES; ++k) lanes[k] += slope[i + k] * difference[i + k];
    for (int k = 0; k < LANES; ++k) total += lanes[k];
}
if (!back) sum[part] = (float)total;
