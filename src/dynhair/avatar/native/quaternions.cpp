// Shared by both directions: Gaussians of the head, 16 at a time; quaternions are wxyz.

typedef float Vec __attribute__((ext_vector_type(16)));
typedef long long i64;

// Rows of `width` numbers from and to columns of 16; lanes beyond `some` repeat the last row, and are not written.
struct Rows {
    static inline void read(const float* rows, int width, int some, Vec* columns)
    {
        alignas(64) float lanes[8][16];
        for (int l = 0; l < 16; ++l)
            for (int k = 0; k < width; ++k) lanes[k][l] = rows[(l < some ? l : some - 1) * width + k];
        for (int k = 0; k < width; ++k) columns[k] = *(const Vec*)lanes[k];
    }
    static inline void write(const Vec* columns, int width, int some, float* rows)
    {
        alignas(64) float lanes[8][16];
        for (int k = 0; k < width; ++k) *(Vec*)lanes[k] = columns[k];
        for (int l = 0; l < some; ++l)
            for (int k = 0; k < width; ++k) rows[l * width + k] = lanes[k][l];
    }
};

struct Quaternions {
    Vec w, x, y, z;

    inline Quaternions conjugate() const { return {w, -x, -y, -z}; }
    inline Vec dot(const Quaternions& o) const { return w * o.w + x * o.x + y * o.y + z * o.z; }
    inline Quaternions times(Vec s) const { return {w * s, x * s, y * s, z * s}; }
    inline Quaternions plus(const Quaternions& o) const { return {w + o.w, x + o.x, y + o.y, z + o.z}; }
    inline Quaternions after(const Quaternions& o) const  // Hamilton product
    {
        return {w * o.w - x * o.x - y * o.y - z * o.z, w * o.x + x * o.w + y * o.z - z * o.y,
                w * o.y - x * o.z + y * o.w + z * o.x, w * o.z + x * o.y - y * o.x + z * o.w};
    }
};

// Sixteen Gaussians on their way from the head frame to the world.
//
// means, quats    (n, 3), (n, 4) in the head frame
// moved           (n, 3): displacement over `reaches[0]`
// offsets         (n, 8) over `reaches[1]`: of log-scales, quaternions, opacity logits
// follow          (n,): 1 for what moves with the head, 0 for what moves with the body
// slots           (n,): row of a Gaussian in shifts (m, 3), turns (m, 4) and growth (m,), or -1
// frames          head's rotation, translation, body's rotation, translation, head's quaternion, body's: 32 numbers
struct Posed {
    Vec mean[3], with_head[3], with_body[3], share, norm, blended_norm;
    Quaternions canonical, turn, local, head, body, between, world;

    inline void enter(const float* frames, const float* reaches, const float* means, const float* quats,
                      const float* moved, const float* offsets, const float* follow, const int* slots,
                      const float* shifts, const float* turns, int some)
    {
        Vec shift[3], offset[8], quat[4];
        Rows::read(means, 3, some, mean);
        Rows::read(moved, 3, some, shift);
        Rows::read(offsets, 8, some, offset);
        Rows::read(quats, 4, some, quat);
        Rows::read(follow, 1, some, &share);
        for (int c = 0; c < 3; ++c) mean[c] += reaches[0] * shift[c];
        turn = {1.0f, 0.0f, 0.0f, 0.0f};
        for (int l = 0; l < some; ++l) {
            const int slot = slots[l];
            if (slot < 0) continue;
            for (int c = 0; c < 3; ++c) mean[c][l] += shifts[3 * slot + c];
            turn.w[l] = turns[4 * slot], turn.x[l] = turns[4 * slot + 1];
            turn.y[l] = turns[4 * slot + 2], turn.z[l] = turns[4 * slot + 3];
        }
        for (int r = 0; r < 3; ++r) {
            with_head[r] = frames[9 + r], with_body[r] = frames[21 + r];
            for (int c = 0; c < 3; ++c) {
                with_head[r] += frames[3 * r + c] * mean[c];
                with_body[r] += frames[12 + 3 * r + c] * mean[c];
            }
        }
        for (int k = 0; k < 4; ++k) quat[k] += reaches[1] * offset[3 + k];
        canonical = {quat[0], quat[1], quat[2], quat[3]};
        norm = __builtin_elementwise_max(__builtin_elementwise_sqrt(canonical.dot(canonical)), (Vec)1e-12f);
        canonical = canonical.times(1.0f / norm);
        local = turn.after(canonical);
        head = {frames[24], frames[25], frames[26], frames[27]};
        body = {frames[28], frames[29], frames[30], frames[31]};
        between = body.times(1.0f - share).plus(head.times(share));
        world = between.after(local);
        blended_norm = __builtin_elementwise_max(__builtin_elementwise_sqrt(world.dot(world)), (Vec)1e-12f);
        world = world.times(1.0f / blended_norm);
    }
};
