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
f4_any* place = (f4_any*)scratch.data;
lane::pack(position.data, inverse_mass.data, place, position.shape[0]);
auto project = [&](int c, int n) __attribute__((always_inline)) {
    int I[8], J[8];
    for (int l = 0; l < 8; l++) {
        I[l] = pairs.data[c + (l < n ? l : 0)][0];
        J[l] = pairs.data[c + (l < n ? l : 0)][1];
    }
    f8x4 a = lane::rows4(place, I), b = lane::rows4(place, J);
    f8 rest = lane::some(rest_length.data + c, n);
    f8 soft = lane::some(compliance.data + c, n) * inverse_dt2;
    f8x3 d = {a.x - b.x, a.y - b.y, a.z - b.z};
    f8 w = a.w + b.w, length = lane::sqrt(lane::dot(d, d));
    i8 acts = (w > 0.0f) & (length > 1.0e-9f);
    w = acts ? w : 1.0f;
    f8 s = (rest - length) / (w + soft);
    if (damping_rate >= 0.0f) {
        f8 steps, before = lane::some(length_before.data + c, n);
        for (int l = 0; l < 8; l++)
            steps[l] = damping_rate * materials.data[garment.data[I[l]]].stretch_damping;
        s -= lane::damping(before, length, steps, soft, w);
        lane::put(length_before.data + c, acts ? length : before, n);
    }
    i8 torn = acts & (length > TORN_STRETCH * rest);
    if (lane::bits(torn))
        for (int l = 0; l < n; l++)
            if (torn[l]) is_torn.data[I[l]] = is_torn.data[J[l]] = 1;
    s = acts ? s / length : 0.0f;
    f8 sa = s * a.w, sb = s * b.w;
    lane::set_rows4(place, I, {a.x + d.x * sa, a.y + d.y * sa, a.z + d.z * sa, a.w}, n);
    lane::set_rows4(place, J, {b.x - d.x * sb, b.y - d.y * sb, b.z - d.z * sb, b.w}, n);
};
FOR_EACH_COLOUR(project)
lane::unpack(place, position.data, position.shape[0]);
""",
)
