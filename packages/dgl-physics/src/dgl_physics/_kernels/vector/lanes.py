"""Prelude of all vector code: eight lanes, read from rows of arrays and written back."""

from dgl_physics._kernels.damping import COUPLING

LANES = (
    f"constexpr float COUPLING = {float(COUPLING)}f;"
    """
typedef float f8 __attribute__((ext_vector_type(8)));
typedef int i8 __attribute__((ext_vector_type(8)));
typedef bool b8 __attribute__((ext_vector_type(8)));
typedef float f4 __attribute__((ext_vector_type(4)));
typedef float f2_any __attribute__((ext_vector_type(2), aligned(4), may_alias));
typedef float f4_any __attribute__((ext_vector_type(4), aligned(4), may_alias));
typedef float f8_any __attribute__((ext_vector_type(8), aligned(4), may_alias));
typedef int i8_any __attribute__((ext_vector_type(8), aligned(4), may_alias));
struct f8x3 { f8 x, y, z; };
struct f8x4 { f8 x, y, z, w; };

struct lane {
    static inline f8 all(float s) { return (f8)(s); }
    static inline f8 min(f8 a, f8 b) { return __builtin_elementwise_min(a, b); }
    static inline f8 max(f8 a, f8 b) { return __builtin_elementwise_max(a, b); }
    static inline f8 sqrt(f8 a) { return __builtin_elementwise_sqrt(a); }
    static inline f8 join(f4 a, f4 b) {
        return __builtin_shufflevector(a, b, 0, 1, 2, 3, 4, 5, 6, 7);
    }
    static inline f8 dot(f8x3 a, f8x3 b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
    static inline f8 load(const float* p) { return *(const f8_any*)p; }
    static inline void store(float* p, f8 v) { *(f8_any*)p = v; }

    // The first n of eight numbers in a row; the other lanes repeat the first and are not written.
    static inline f8 some(const float* p, int n) {
        if (n == 8) return load(p);
        f8 v;
        for (int l = 0; l < 8; l++) v[l] = p[l < n ? l : 0];
        return v;
    }
    static inline i8 some(const int* p, int n) {
        return __builtin_bit_cast(i8, some((const float*)p, n));
    }
    static inline void put(int* p, i8 v, int n) { put((float*)p, __builtin_bit_cast(f8, v), n); }
    static inline void put(float* p, f8 v, int n) {
        if (n == 8) store(p, v);
        else
            for (int l = 0; l < n; l++) p[l] = v[l];
    }
    static inline int bits(i8 m) {
        return __builtin_bit_cast(unsigned char, __builtin_convertvector(m, b8));
    }
    static inline f8 pick(const float* p, const int* i) {
        return (f8){p[i[0]], p[i[1]], p[i[2]], p[i[3]], p[i[4]], p[i[5]], p[i[6]], p[i[7]]};
    }
    // Moves the lanes whose bits are set to the front, in their order.
    static inline i8 compress(i8 v, int bits) {
#ifdef __AVX2__
        static constexpr struct Order {
            unsigned char of[256][8];
            constexpr Order() : of() {
                for (int b = 0; b < 256; b++)
                    for (int l = 0, n = 0; l < 8; l++)
                        if (b >> l & 1) of[b][n++] = l;
            }
        } order{};
        typedef unsigned char u8x8 __attribute__((ext_vector_type(8), aligned(1), may_alias));
        i8 moved = __builtin_convertvector(*(const u8x8*)order.of[bits], i8);
        return __builtin_ia32_permvarsi256(v, moved);
#else
        i8 w = v;
        for (int l = 0, n = 0; l < 8; l++)
            if (bits >> l & 1) w[n++] = v[l];
        return w;
#endif
    }
    static inline void store(int* p, i8 v) { *(i8_any*)p = v; }
    static inline i8 load(const int* p) { return *(const i8_any*)p; }

    static inline i8 pick(const int* p, const int* i) {
        return __builtin_bit_cast(i8, pick((const float*)p, i));
    }
    // Batcher's network: each step orders lanes by pairs.
    static inline i8 sort(i8 v) {
#define ORDER(a, b, c, d, e, f, g, h, low) { \\
        i8 w = __builtin_shufflevector(v, v, a, b, c, d, e, f, g, h); \\
        v = (i8)low ? __builtin_elementwise_min(v, w) : __builtin_elementwise_max(v, w); }
        const int L = -1, H = 0;
        ORDER(1, 0, 3, 2, 5, 4, 7, 6, (i8{L, H, L, H, L, H, L, H}))
        ORDER(2, 3, 0, 1, 6, 7, 4, 5, (i8{L, L, H, H, L, L, H, H}))
        ORDER(0, 2, 1, 3, 4, 6, 5, 7, (i8{L, L, H, L, L, L, H, L}))
        ORDER(4, 5, 6, 7, 0, 1, 2, 3, (i8{L, L, L, L, H, H, H, H}))
        ORDER(0, 1, 4, 5, 2, 3, 6, 7, (i8{L, L, L, L, H, H, L, L}))
        ORDER(0, 2, 1, 4, 3, 6, 5, 7, (i8{L, L, H, L, H, L, H, L}))
#undef ORDER
        return v;
    }

    // See `_kernels.damping.compute_damping`.
    static inline f8 damping(f8 before, f8 value, f8 steps, f8 compliance, f8 w) {
        f8 resolved = compliance / (compliance + w);
        f8 most = max(compliance, COUPLING * w * steps);
        f8 change = resolved * steps * (value - before) / most;
        i8 none = (steps == 0.0f) | (before < 0.0f);
        return none ? all(0.0f) : change;
    }

    // Rows of three or four numbers.
    static inline f4 row3(const wp::vec3* p, int i) {
        const float* q = (const float*)(p + i);
        f2_any xy = *(const f2_any*)q;
        return (f4){xy.x, xy.y, q[2], 0.0f};
    }
    static inline void set_row3(wp::vec3* p, int i, f4 v) {
        float* q = (float*)(p + i);
        *(f2_any*)q = v.xy;
        q[2] = v.z;
    }
    static inline f4 row4(const wp::vec4* p, int i) { return *(const f4_any*)(p + i); }
    static inline f8x4 turn(f4 a, f4 b, f4 c, f4 d, f4 e, f4 f, f4 g, f4 h) {
        f8 ae = __builtin_shufflevector(a, e, 0, 1, 2, 3, 4, 5, 6, 7);
        f8 bf = __builtin_shufflevector(b, f, 0, 1, 2, 3, 4, 5, 6, 7);
        f8 cg = __builtin_shufflevector(c, g, 0, 1, 2, 3, 4, 5, 6, 7);
        f8 dh = __builtin_shufflevector(d, h, 0, 1, 2, 3, 4, 5, 6, 7);
        f8 p = __builtin_shufflevector(ae, bf, 0, 8, 1, 9, 4, 12, 5, 13);
        f8 q = __builtin_shufflevector(ae, bf, 2, 10, 3, 11, 6, 14, 7, 15);
        f8 r = __builtin_shufflevector(cg, dh, 0, 8, 1, 9, 4, 12, 5, 13);
        f8 s = __builtin_shufflevector(cg, dh, 2, 10, 3, 11, 6, 14, 7, 15);
        return {__builtin_shufflevector(p, r, 0, 1, 8, 9, 4, 5, 12, 13),
                __builtin_shufflevector(p, r, 2, 3, 10, 11, 6, 7, 14, 15),
                __builtin_shufflevector(q, s, 0, 1, 8, 9, 4, 5, 12, 13),
                __builtin_shufflevector(q, s, 2, 3, 10, 11, 6, 7, 14, 15)};
    }
    // The first n of eight rows side by side; the other lanes repeat the first.
    static inline f8x3 some3(const wp::vec3* p, int n) {
        const float* q = (const float*)p;
        if (n == 8) {
            f8 a = load(q), b = load(q + 8), c = load(q + 16);
            f8 x = __builtin_shufflevector(a, b, 0, 3, 6, 9, 12, 15, -1, -1);
            f8 y = __builtin_shufflevector(a, b, 1, 4, 7, 10, 13, -1, -1, -1);
            f8 z = __builtin_shufflevector(a, b, 2, 5, 8, 11, 14, -1, -1, -1);
            return {__builtin_shufflevector(x, c, 0, 1, 2, 3, 4, 5, 10, 13),
                    __builtin_shufflevector(y, c, 0, 1, 2, 3, 4, 8, 11, 14),
                    __builtin_shufflevector(z, c, 0, 1, 2, 3, 4, 9, 12, 15)};
        }
        f8x3 v;
        for (int l = 0; l < 8; l++) {
            const float* r = q + (l < n ? 3 * l : 0);
            v.x[l] = r[0], v.y[l] = r[1], v.z[l] = r[2];
        }
        return v;
    }
    // Writes those of eight rows side by side whose bits are set.
    static inline void put3(wp::vec3* p, f8x3 v, int bits) {
        float* q = (float*)p;
        if (bits == 255) {
            f8 a = __builtin_shufflevector(v.x, v.y, 0, 8, -1, 1, 9, -1, 2, 10);
            f8 b = __builtin_shufflevector(v.x, v.y, -1, 3, 11, -1, 4, 12, -1, 5);
            f8 c = __builtin_shufflevector(v.x, v.y, 13, -1, 6, 14, -1, 7, 15, -1);
            store(q, __builtin_shufflevector(a, v.z, 0, 1, 8, 3, 4, 9, 6, 7));
            store(q + 8, __builtin_shufflevector(b, v.z, 10, 1, 2, 11, 4, 5, 12, 7));
            store(q + 16, __builtin_shufflevector(c, v.z, 0, 13, 2, 3, 14, 5, 6, 15));
            return;
        }
        for (int l = 0; l < 8; l++)
            if (bits >> l & 1) q[3 * l] = v.x[l], q[3 * l + 1] = v.y[l], q[3 * l + 2] = v.z[l];
    }
    static inline f8x3 rows3(const wp::vec3* p, const int* i) {
        f8x4 v = turn(row3(p, i[0]), row3(p, i[1]), row3(p, i[2]), row3(p, i[3]),
                      row3(p, i[4]), row3(p, i[5]), row3(p, i[6]), row3(p, i[7]));
        return {v.x, v.y, v.z};
    }
    static inline f8x4 rows4(const f4_any* p, const int* i) {
        return turn(p[i[0]], p[i[1]], p[i[2]], p[i[3]], p[i[4]], p[i[5]], p[i[6]], p[i[7]]);
    }
    static inline f8x4 rows4(const wp::vec4* p, const int* i) { return rows4((const f4_any*)p, i); }
    static inline void back(f8x4 v, f4* rows) {
        f8 p = __builtin_shufflevector(v.x, v.y, 0, 8, 1, 9, 4, 12, 5, 13);
        f8 q = __builtin_shufflevector(v.x, v.y, 2, 10, 3, 11, 6, 14, 7, 15);
        f8 r = __builtin_shufflevector(v.z, v.w, 0, 8, 1, 9, 4, 12, 5, 13);
        f8 s = __builtin_shufflevector(v.z, v.w, 2, 10, 3, 11, 6, 14, 7, 15);
        f8 ae = __builtin_shufflevector(p, r, 0, 1, 8, 9, 4, 5, 12, 13);
        f8 bf = __builtin_shufflevector(p, r, 2, 3, 10, 11, 6, 7, 14, 15);
        f8 cg = __builtin_shufflevector(q, s, 0, 1, 8, 9, 4, 5, 12, 13);
        f8 dh = __builtin_shufflevector(q, s, 2, 3, 10, 11, 6, 7, 14, 15);
        rows[0] = ae.lo; rows[1] = bf.lo; rows[2] = cg.lo; rows[3] = dh.lo;
        rows[4] = ae.hi; rows[5] = bf.hi; rows[6] = cg.hi; rows[7] = dh.hi;
    }
    static inline void set_rows4(f4_any* p, const int* i, f8x4 v, int n) {
        f4 rows[8];
        back(v, rows);
        for (int l = 0; l < n; l++) p[i[l]] = rows[l];
    }

    // Positions packed with inverse masses are faster to gather and scatter than rows of three.
    static inline void pack(
        const wp::vec3* place, const float* inverse_mass, f4_any* packed, int count) {
        for (int i = 0; i < count; i++) {
            f4 x = row3(place, i);
            x.w = inverse_mass[i];
            packed[i] = x;
        }
    }
    static inline void unpack(const f4_any* packed, wp::vec3* place, int count) {
        for (int i = 0; i < count; i++) set_row3(place, i, packed[i]);
    }
};
#define FOR_EACH_COLOUR(project) \\
    for (int q = 0; q + 1 < colour_start.shape[0]; q++) { \\
        int c = colour_start.data[q], end = colour_start.data[q + 1]; \\
        for (; c + 8 <= end; c += 8) project(c, 8); \\
        if (c < end) project(c, end - c); \\
    }
"""
)
"""Lanes `f8`; `rows3` and `rows4` gather rows of arrays into lanes, `set_rows4` scatters them."""
