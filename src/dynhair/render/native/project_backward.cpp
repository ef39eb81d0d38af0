// Gaussians [first, last): gradients with respect to their splats -> gradients with respect to themselves.
//
// camera, means, quats, scales, opacities   as for project.cpp
// grads           (slices, n, stride), as written by blend_backward.cpp; the slices are added up in order
// grad_*          overwritten, or added to where `accumulate` (`accumulate_features`) is set


typedef float Quad __attribute__((ext_vector_type(4), aligned(4)));
typedef int QuadTruth __attribute__((ext_vector_type(4)));

// Writes the first `count` lanes of `columns` to rows of `width` floats, or adds them there.
auto scatter = [=](const Vec* columns, int width, int count, float* rows) {
    alignas(64) float lanes[4][16];
    for (int k = 0; k < width; ++k) Simd::store(lanes[k], columns[k]);
    if (accumulate)
        for (int l = 0; l < count; ++l)
            for (int k = 0; k < width; ++k) rows[l * width + k] += lanes[k][l];
    else
        for (int l = 0; l < count; ++l)
            for (int k = 0; k < width; ++k) rows[l * width + k] = lanes[k][l];
};

for (int base = first; base < last; base += 16) {
    const int count = last - base < 16 ? last - base : 16;

    // The parts of a splat's gradient, summed over slices: the header into columns, the features to where they belong.
    alignas(64) float lanes[FEATURES][16] = {};
    unsigned any = 0;
    for (int l = 0; l < count; ++l) {
        const float* row = grads + (base + l) * (i64)stride;
        alignas(16) float header[FEATURES];
        for (int k = 0; k < FEATURES; k += 4) {
            Quad sum = *(const Quad*)(row + k);
            for (int s = 1; s < slices; ++s) sum += *(const Quad*)(row + (i64)s * n * stride + k);
            *(Quad*)(header + k) = sum;
            any |= __builtin_reduce_or((QuadTruth)(sum != 0.0f));
        }
        for (int k = 0; k < FEATURES; ++k) lanes[k][l] = header[k];

        float* feature = grad_features + (base + l) * (i64)channels;
        for (int c = 0; c < channels; c += 4) {
            Quad sum = *(const Quad*)(row + FEATURES + c);  // there is room: splats have a multiple of 4 features
            for (int s = 1; s < slices; ++s) sum += *(const Quad*)(row + (i64)s * n * stride + FEATURES + c);
            if (c + 4 <= channels)
                *(Quad*)(feature + c) = accumulate_features ? sum + *(const Quad*)(feature + c) : sum;
            else
                for (int k = 0; c + k < channels; ++k)
                    feature[c + k] = sum[k] + (accumulate_features ? feature[c + k] : 0.0f);
        }
    }
    Vec d_mean[3] = {}, d_quat[4] = {}, d_scale[3] = {}, d_opacity[1] = {};
    if (any) {
        Vec g[FEATURES];
        for (int k = 0; k < FEATURES; ++k) g[k] = Simd::load(lanes[k]);
        Projection p;
        p.project(camera, means + (i64)3 * base, quats + (i64)4 * base, scales + (i64)3 * base, count);
        const float* W = camera;
        const float fx = camera[12], fy = camera[13];

        Vec opacity;
        Projection::gather(opacities + base, 1, count, &opacity);
        d_opacity[0] = g[0] / opacity;

        // The conic K is the inverse of the covariance; dL/dcov = -K (dL/dK) K.
        const Vec kxx = p.cov_yy * p.inverse_det, kxy = -p.cov_xy * p.inverse_det, kyy = p.cov_xx * p.inverse_det;
        const Vec d_x2d = kxx * g[1] + kxy * g[2], d_y2d = kxy * g[1] + kyy * g[2];
        const Vec d_kxx = -0.5f * g[3], d_kxy = -0.5f * g[4], d_kyy = -0.5f * g[5];
        const Vec a = kxx * d_kxx + kxy * d_kxy, b = kxx * d_kxy + kxy * d_kyy;
        const Vec c = kxy * d_kxx + kyy * d_kxy, d = kxy * d_kxy + kyy * d_kyy;
        const Vec d_xx = -(a * kxx + b * kxy), d_xy = -(a * kxy + b * kyy), d_yy = -(c * kxy + d * kyy);

        Vec d_U[2][3], d_M[3][3], M[3][3];  // M = R diag(scale), U = T M
        for (int k = 0; k < 3; ++k) {
            d_U[0][k] = 2.0f * (d_xx * p.U[0][k] + d_xy * p.U[1][k]);
            d_U[1][k] = 2.0f * (d_xy * p.U[0][k] + d_yy * p.U[1][k]);
        }
        // g[0] is the gradient of the logarithm of what is drawn, and so of that of the share sqrt(own_det / det).
        const Vec of_own_det = g[0] / p.own_det, of_det = g[0] * p.inverse_det, of_cross = of_own_det - of_det;
        for (int k = 0; k < 3; ++k) {
            const int l = (k + 1) % 3, m = (k + 2) % 3;
            d_U[0][k] += of_cross * (p.U[1][l] * p.cross[m] - p.U[1][m] * p.cross[l]) - DILATION * of_det * p.U[0][k];
            d_U[1][k] += of_cross * (p.cross[l] * p.U[0][m] - p.cross[m] * p.U[0][l]) - DILATION * of_det * p.U[1][k];
        }
        for (int k = 0; k < 3; ++k) {
            for (int r = 0; r < 3; ++r) {
                d_M[r][k] = p.T[0][r] * d_U[0][k] + p.T[1][r] * d_U[1][k];
                M[r][k] = p.R[r][k] * p.scale[k];
            }
            d_scale[k] = d_M[0][k] * p.R[0][k] + d_M[1][k] * p.R[1][k] + d_M[2][k] * p.R[2][k];
            for (int r = 0; r < 3; ++r) d_M[r][k] *= p.scale[k];  // now dL/dR
        }

        const Vec w = p.q[0], i = p.q[1], j = p.q[2], k = p.q[3];
        d_quat[0] = i * (d_M[2][1] - d_M[1][2]) + j * (d_M[0][2] - d_M[2][0]) + k * (d_M[1][0] - d_M[0][1]);
        d_quat[1] = w * (d_M[2][1] - d_M[1][2]) + j * (d_M[1][0] + d_M[0][1]) + k * (d_M[2][0] + d_M[0][2]) -
                    2.0f * i * (d_M[1][1] + d_M[2][2]);
        d_quat[2] = w * (d_M[0][2] - d_M[2][0]) + i * (d_M[1][0] + d_M[0][1]) + k * (d_M[2][1] + d_M[1][2]) -
                    2.0f * j * (d_M[0][0] + d_M[2][2]);
        d_quat[3] = w * (d_M[1][0] - d_M[0][1]) + i * (d_M[2][0] + d_M[0][2]) + j * (d_M[2][1] + d_M[1][2]) -
                    2.0f * k * (d_M[0][0] + d_M[1][1]);
        const Vec along = d_quat[0] * w + d_quat[1] * i + d_quat[2] * j + d_quat[3] * k;
        for (int e = 0; e < 4; ++e) d_quat[e] = 2.0f * (d_quat[e] - along * p.q[e]) * p.inverse_norm;

        // T = fx/z (row of W - slope * last row of W), and the same with y.
        Vec d_jx = {}, d_jy = {}, d_slope_x = {}, d_slope_y = {};
        const Vec jx = fx * p.inverse_z, jy = fy * p.inverse_z;
        for (int e = 0; e < 3; ++e) {
            const Vec d_Tx = d_U[0][0] * M[e][0] + d_U[0][1] * M[e][1] + d_U[0][2] * M[e][2];
            const Vec d_Ty = d_U[1][0] * M[e][0] + d_U[1][1] * M[e][1] + d_U[1][2] * M[e][2];
            d_jx += d_Tx * (W[e] - p.slope_x * W[8 + e]);
            d_jy += d_Ty * (W[4 + e] - p.slope_y * W[8 + e]);
            d_slope_x -= d_Tx * jx * W[8 + e];
            d_slope_y -= d_Ty * jy * W[8 + e];
        }
        d_slope_x = Simd::keep(p.free_x, d_slope_x) + fx * d_x2d;
        d_slope_y = Simd::keep(p.free_y, d_slope_y) + fy * d_y2d;
        const Vec d_x = d_slope_x * p.inverse_z, d_y = d_slope_y * p.inverse_z;
        const Vec d_z = g[DEPTH] - (d_x * p.x + d_y * p.y + d_jx * jx + d_jy * jy) * p.inverse_z;
        for (int e = 0; e < 3; ++e) d_mean[e] = W[e] * d_x + W[4 + e] * d_y + W[8 + e] * d_z;

        // A Gaussian that was not drawn may hold anything, NaN included; its gradient is zero.
        Lanes drawn = {};
        for (int k = 0; k < FEATURES; ++k) drawn |= g[k] != 0.0f;
        for (int e = 0; e < 3; ++e) d_mean[e] = Simd::keep(drawn, d_mean[e]);
        for (int e = 0; e < 4; ++e) d_quat[e] = Simd::keep(drawn, d_quat[e]);
        for (int e = 0; e < 3; ++e) d_scale[e] = Simd::keep(drawn, d_scale[e]);
        d_opacity[0] = Simd::keep(drawn, d_opacity[0]);
    }
    scatter(d_mean, 3, count, grad_means + (i64)3 * base);
    scatter(d_quat, 4, count, grad_quats + (i64)4 * base);
    scatter(d_scale, 3, count, grad_scales + (i64)3 * base);
    scatter(d_opacity, 1, count, grad_opacities + base);
}
