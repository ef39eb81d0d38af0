// Pixels [first, last): features taken apart, or, where `back` is set, the gradients put together.
//
// features        (pixels, 4 + channels): two labels, a doubled angle, what is seen over black
// alpha           (pixels,), background (channels,)
// seen, hair, body, direction   (pixels, channels), (pixels,), (pixels,), (pixels, 2): the layers

for (int pixel = first; pixel < last; ++pixel) {
    float* const whole = features + (long long)pixel * (4 + channels);
    float* const colours = seen + (long long)pixel * channels;
    if (back) {
        whole[0] = hair[pixel];
        whole[1] = body[pixel];
        whole[2] = direction[2 * pixel];
        whole[3] = direction[2 * pixel + 1];
        float behind = 0.0f;
        for (int c = 0; c < channels; ++c) {
            whole[4 + c] = colours[c];
            behind += colours[c] * background[c];
        }
        alpha[pixel] = -behind;
    } else {
        hair[pixel] = whole[0];
        body[pixel] = whole[1];
        direction[2 * pixel] = whole[2];
        direction[2 * pixel + 1] = whole[3];
        for (int c = 0; c < channels; ++c) colours[c] = whole[4 + c] + (1.0f - alpha[pixel]) * background[c];
    }
}
