"""Twin of `_kernels.bending`."""

from dgl_physics._kernels import bending
from dgl_physics._kernels.vector.twin import make_twin

solve_bending = make_twin(
    bending.solve_bending,
    """
const int* members = (const int*)hinges.data;
const float* pairs = (const float*)response.data;
auto project = [&](int k, int n) __attribute__((always_inline)) {
    int at[8], I[4][8];
    f8 compliance, time;
    for (int l = 0; l < 8; l++) {
        at[l] = k + (l < n ? l : 0);
        compliance[l] = pairs[2 * at[l]];
        time[l] = pairs[2 * at[l] + 1];
        for (int q = 0; q < 4; q++) I[q][l] = members[4 * at[l] + q];
    }
    f8x4 weight = lane::rows4(weights.data, at);
    f8 wa = lane::pick(inverse_mass.data, I[0]), wb = lane::pick(inverse_mass.data, I[1]);
    f8 wc = lane::pick(inverse_mass.data, I[2]), wd = lane::pick(inverse_mass.data, I[3]);
    f8 fa = weight.x * wa, fb = weight.y * wb, fc = weight.z * wc, fd = weight.w * wd;
    f8x3 a = lane::rows3(position.data, I[0]), b = lane::rows3(position.data, I[1]);
    f8x3 c = lane::rows3(position.data, I[2]), d = lane::rows3(position.data, I[3]);
    f8x3 bend = {weight.x * a.x + weight.y * b.x + weight.z * c.x + weight.w * d.x,
                 weight.x * a.y + weight.y * b.y + weight.z * c.y + weight.w * d.y,
                 weight.x * a.z + weight.y * b.z + weight.z * c.z + weight.w * d.z};
    i8 acts = wa + wb + wc + wd > 0.0f;
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
    lane::set_rows3(position.data, I[0], {a.x + bend.x * fa, a.y + bend.y * fa, a.z + bend.z * fa}, n);
    lane::set_rows3(position.data, I[1], {b.x + bend.x * fb, b.y + bend.y * fb, b.z + bend.z * fb}, n);
    lane::set_rows3(position.data, I[2], {c.x + bend.x * fc, c.y + bend.y * fc, c.z + bend.z * fc}, n);
    lane::set_rows3(position.data, I[3], {d.x + bend.x * fd, d.y + bend.y * fd, d.z + bend.z * fd}, n);
};
int last = first + count;
for (int k = first; k < last; k += 8)
    if (k + 8 <= last) project(k, 8);
    else project(k, last - k);
""",
)
