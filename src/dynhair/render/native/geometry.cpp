// Perspective projection of 16 Gaussians at a time (3DGS, eq. 5: EWA splatting), shared by its forward and backward.

struct Projection {
    Vec x, y, z, inverse_z;          // camera space
    Vec slope_x, slope_y;            // x/z and y/z, clamped to 1.3 times the field of view for the Jacobian only
    Lanes free_x, free_y;            // where that clamp does nothing
    Vec q[4], inverse_norm;          // unit quaternion wxyz
    Vec R[3][3];                     // of the quaternion
    Vec scale[3];
    Vec T[2][3];                     // Jacobian times world-to-camera rotation
    Vec U[2][3];                     // T R diag(scale): the 2D covariance is U U^T + dilation
    Vec cov_xx, cov_xy, cov_yy, inverse_det;
    Vec cross[3], own_det;           // U[0] x U[1], and its square: the determinant of U U^T, without the dilation

    // Reads 16 rows of `width` floats into columns; rows past the end repeat the last one.
    static inline void gather(const float* rows, int width, int count, Vec* columns)
    {
        alignas(64) float lanes[4][16];
        for (int l = 0; l < 16; ++l) {
            const float* row = rows + (i64)(l < count ? l : count - 1) * width;
            for (int k = 0; k < width; ++k) lanes[k][l] = row[k];
        }
        for (int k = 0; k < width; ++k) columns[k] = Simd::load(lanes[k]);
    }

    // `camera` is w2c (12 floats, row-major), fx, fy, cx, cy, and the four clamps of the slopes: -x, +x, -y, +y.
    inline void project(const float* camera, const float* means, const float* quats, const float* scales, int count)
    {
        const float* W = camera;
        const float fx = camera[12], fy = camera[13];
        Vec mean[3];
        gather(means, 3, count, mean);
        gather(quats, 4, count, q);
        gather(scales, 3, count, scale);

        x = mean[0] * W[0] + mean[1] * W[1] + mean[2] * W[2] + W[3];
        y = mean[0] * W[4] + mean[1] * W[5] + mean[2] * W[6] + W[7];
        z = mean[0] * W[8] + mean[1] * W[9] + mean[2] * W[10] + W[11];
        inverse_z = 1.0f / z;

        inverse_norm = 1.0f / Simd::sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
        for (int k = 0; k < 4; ++k) q[k] *= inverse_norm;
        const Vec w = q[0], i = q[1], j = q[2], k = q[3];
        R[0][0] = 1.0f - 2.0f * (j * j + k * k);
        R[0][1] = 2.0f * (i * j - w * k);
        R[0][2] = 2.0f * (i * k + w * j);
        R[1][0] = 2.0f * (i * j + w * k);
        R[1][1] = 1.0f - 2.0f * (i * i + k * k);
        R[1][2] = 2.0f * (j * k - w * i);
        R[2][0] = 2.0f * (i * k - w * j);
        R[2][1] = 2.0f * (j * k + w * i);
        R[2][2] = 1.0f - 2.0f * (i * i + j * j);

        const Vec raw_x = x * inverse_z, raw_y = y * inverse_z;
        slope_x = Simd::clamp(raw_x, camera[16], camera[17]);
        slope_y = Simd::clamp(raw_y, camera[18], camera[19]);
        free_x = slope_x == raw_x;
        free_y = slope_y == raw_y;
        const Vec jx = fx * inverse_z, jy = fy * inverse_z;
        for (int c = 0; c < 3; ++c) {
            T[0][c] = jx * (W[c] - slope_x * W[8 + c]);
            T[1][c] = jy * (W[4 + c] - slope_y * W[8 + c]);
        }
        for (int r = 0; r < 2; ++r)
            for (int c = 0; c < 3; ++c)
                U[r][c] = (T[r][0] * R[0][c] + T[r][1] * R[1][c] + T[r][2] * R[2][c]) * scale[c];

        const Vec xx = U[0][0] * U[0][0] + U[0][1] * U[0][1] + U[0][2] * U[0][2];
        const Vec yy = U[1][0] * U[1][0] + U[1][1] * U[1][1] + U[1][2] * U[1][2];
        cov_xx = xx + DILATION;
        cov_xy = U[0][0] * U[1][0] + U[0][1] * U[1][1] + U[0][2] * U[1][2];
        cov_yy = yy + DILATION;
        // |u|^2 |v|^2 - (u.v)^2 = |u x v|^2: cov_xx * cov_yy - cov_xy^2 would cancel for long thin Gaussians.
        cross[0] = U[0][1] * U[1][2] - U[0][2] * U[1][1];
        cross[1] = U[0][2] * U[1][0] - U[0][0] * U[1][2];
        cross[2] = U[0][0] * U[1][1] - U[0][1] * U[1][0];
        own_det = cross[0] * cross[0] + cross[1] * cross[1] + cross[2] * cross[2];
        inverse_det = 1.0f / (own_det + DILATION * (xx + yy) + DILATION * DILATION);
    }
};
