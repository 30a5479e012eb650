"""Twins of `_kernels.cloth`: integration and distance constraints."""

from dgl_physics._kernels import cloth
from dgl_physics._kernels.vector.twin import make_twin

integrate = make_twin(
    cloth.integrate,
    """
f4 pull = {gravity[0], gravity[1], gravity[2], 0.0f};
for (int i = 0; i < count; i++) {
    f4 x = lane::row3(position.data, i);
    lane::set_row3(previous.data, i, x);
    if (inverse_mass.data[i] == 0.0f) continue;
    f4 v = lane::row3(velocity.data, i) + pull * (gravity_scale.data[environment.data[i]] * dt);
    v = v / (1.0f + materials.data[garment.data[i]].drag * dt);
    lane::set_row3(velocity.data, i, v);
    lane::set_row3(position.data, i, x + v * dt);
}
""",
)

solve_distances = make_twin(
    cloth.solve_distances,
    f"const float TORN_STRETCH = {float(cloth.TORN_STRETCH)}f;"
    """
const wp::vec2i* ends = pairs.data;
auto project = [&](int c, int n) __attribute__((always_inline)) {
    int I[8], J[8];
    for (int l = 0; l < 8; l++) {
        I[l] = ends[c + (l < n ? l : 0)][0];
        J[l] = ends[c + (l < n ? l : 0)][1];
    }
    f8x3 a = lane::rows3(position.data, I), b = lane::rows3(position.data, J);
    f8 wi = lane::pick(inverse_mass.data, I), wj = lane::pick(inverse_mass.data, J);
    f8 rest = lane::some(rest_length.data + c, n), soft = lane::some(compliance.data + c, n) * inverse_dt2;
    f8x3 d = {a.x - b.x, a.y - b.y, a.z - b.z};
    f8 w = wi + wj, length = lane::sqrt(lane::dot(d, d));
    i8 acts = (w > 0.0f) & (length > 1.0e-9f);
    w = acts ? w : 1.0f;
    f8 s = (rest - length) / (w + soft);
    if (damping_rate >= 0.0f) {
        f8 steps;
        for (int l = 0; l < 8; l++)
            steps[l] = damping_rate * materials.data[garment.data[I[l]]].stretch_damping;
        f8 before = lane::some(length_before.data + c, n);
        s -= lane::damping(before, length, steps, soft, w);
        lane::put(length_before.data + c, acts ? length : before, n);
    }
    i8 torn = acts & (length > TORN_STRETCH * rest);
    if (lane::bits(torn))
        for (int l = 0; l < n; l++)
            if (torn[l]) is_torn.data[I[l]] = is_torn.data[J[l]] = 1;
    s = acts ? s / length : 0.0f;
    f8 sa = s * wi, sb = s * wj;
    lane::set_rows3(position.data, I, {a.x + d.x * sa, a.y + d.y * sa, a.z + d.z * sa}, n);
    lane::set_rows3(position.data, J, {b.x - d.x * sb, b.y - d.y * sb, b.z - d.z * sb}, n);
};
int last = first + count;
for (int c = first; c < last; c += 8)
    if (c + 8 <= last) project(c, 8);
    else project(c, last - c);
""",
)
