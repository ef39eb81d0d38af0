// Pixels [first, last): colours as far as labels agree, the truth's where they do not; or, where `back` is set, the
// gradient with respect to the colours.
//
// colours, truth, result   (pixels, channels); `result` is given where `back` is set, and `colours` written
// hair, body, true_hair, true_body   (pixels,)

for (int pixel = first; pixel < last; ++pixel) {
    const float of_hair = hair[pixel] - true_hair[pixel], of_body = body[pixel] - true_body[pixel];
    const float off = 0.5f * (__builtin_fabsf(of_hair) + __builtin_fabsf(of_body) + __builtin_fabsf(of_hair + of_body));
    const float agreed = off >= 1.0f ? 0.0f : 1.0f - off;
    for (long long k = (long long)pixel * channels; k < (long long)(pixel + 1) * channels; ++k) {
        if (back) colours[k] = agreed * result[k];
        else result[k] = truth[k] + agreed * (colours[k] - truth[k]);
    }
}
