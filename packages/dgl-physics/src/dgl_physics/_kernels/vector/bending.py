"""Twin of `_kernels.bending`."""

from dgl_physics._kernels import bending
from dgl_physics._kernels.vector.twin import make_twin

solve_bending = make_twin(
    bending.solve_bending,
    """
f4_any* place = (f4_any*)scratch.data;
lane::pack(position.data, inverse_mass.data, place, position.shape[0]);
const int* members = (const int*)hinges.data;
auto project = [&](int k, int n) __attribute__((always_inline)) {
    int at[8], I[4][8];
    f8 compliance, time;
    for (int l = 0; l < 8; l++) {
        at[l] = k + (l < n ? l : 0);
        compliance[l] = response.data[at[l]][0];
        time[l] = response.data[at[l]][1];
        for (int q = 0; q < 4; q++) I[q][l] = members[4 * at[l] + q];
    }
    f8x4 weight = lane::rows4(weights.data, at);
    f8x4 a = lane::rows4(place, I[0]), b = lane::rows4(place, I[1]);
    f8x4 c = lane::rows4(place, I[2]), d = lane::rows4(place, I[3]);
    f8 fa = weight.x * a.w, fb = weight.y * b.w, fc = weight.z * c.w, fd = weight.w * d.w;
    f8x3 bend = {weight.x * a.x + weight.y * b.x + weight.z * c.x + weight.w * d.x,
                 weight.x * a.y + weight.y * b.y + weight.z * c.y + weight.w * d.y,
                 weight.x * a.z + weight.y * b.z + weight.z * c.z + weight.w * d.z};
    i8 acts = a.w + b.w + c.w + d.w > 0.0f;
    f8 w = acts ? weight.x * fa + weight.y * fb + weight.z * fc + weight.w * fd : 1.0f;
    f8 length = lane::sqrt(lane::dot(bend, bend));
    compliance = compliance / (dt * dt);
    f8 unresolved = w / (w + compliance);
    f8 s = length / (compliance + w * 0.5f * (1.0f + unresolved * unresolved));
    f8 before = lane::some(length_before.data + k, n);
    s += lane::damping(before, length, rate * time, compliance, w);
    lane::put(length_before.data + k, acts ? length : before, n);
    s = acts ? -s / lane::max(length, lane::all(1.0e-12f)) : 0.0f;
    bend = {bend.x * s, bend.y * s, bend.z * s};
    lane::set_rows4(place, I[0], {a.x + bend.x * fa, a.y + bend.y * fa, a.z + bend.z * fa, a.w}, n);
    lane::set_rows4(place, I[1], {b.x + bend.x * fb, b.y + bend.y * fb, b.z + bend.z * fb, b.w}, n);
    lane::set_rows4(place, I[2], {c.x + bend.x * fc, c.y + bend.y * fc, c.z + bend.z * fc, c.w}, n);
    lane::set_rows4(place, I[3], {d.x + bend.x * fd, d.y + bend.y * fd, d.z + bend.z * fd, d.w}, n);
};
FOR_EACH_COLOUR(project)
lane::unpack(place, position.data, position.shape[0]);
""",
)
