"""Twins of `_kernels.coarse`: nodes of the coarse level."""

from dgl_physics._kernels import coarse
from dgl_physics._kernels.vector.twin import make_twin

gather_nodes = make_twin(
    coarse.gather_nodes,
    """
// Of each particle its place and whether it is held.
f4_any* packed = (f4_any*)scratch.data;
for (int i = 0; i < position.shape[0]; i++) {
    f4 x = lane::row3(position.data, i);
    x.w = is_stuck.data[i] != 0 || inverse_mass.data[i] == 0.0f;
    packed[i] = x;
}
const int* particle = node_particle.data;
const float* weight = node_weight.data;
for (int c = 0; c < count; c++) {
    int k = node_start.data[c], end = node_start.data[c + 1];
    f4 a = 0.0f, b = 0.0f, d = 0.0f, e = 0.0f;
    for (; k + 4 <= end; k += 4) {
        a += weight[k] * packed[particle[k]];
        b += weight[k + 1] * packed[particle[k + 1]];
        d += weight[k + 2] * packed[particle[k + 2]];
        e += weight[k + 3] * packed[particle[k + 3]];
    }
    for (; k < end; k++) a += weight[k] * packed[particle[k]];
    f4 total = (a + b) + (d + e);
    held.data[c] = total.w;
    mobility.data[c] = total.w > 0.0f ? 0.0f : node_inverse_mass.data[c];
    lane::set_row3(centre.data, c, total);
    lane::set_row3(centre_before.data, c, total);
    lane::set_row3(reaction.data, c, (f4)(0.0f));
}
""",
)

solve_limits = make_twin(
    coarse.solve_limits,
    """
f4_any* node = (f4_any*)scratch.data;
lane::pack(centre.data, mobility.data, node, centre.shape[0]);
auto project = [&](int c, int n) __attribute__((always_inline)) {
    int I[8], J[8];
    for (int l = 0; l < 8; l++) {
        I[l] = pairs.data[c + (l < n ? l : 0)][0];
        J[l] = pairs.data[c + (l < n ? l : 0)][1];
    }
    f8x4 a = lane::rows4(node, I), b = lane::rows4(node, J);
    f8x3 d = {a.x - b.x, a.y - b.y, a.z - b.z};
    f8 length = lane::sqrt(lane::dot(d, d)), most = lane::some(limit.data + c, n);
    int over = lane::bits((length > most) & (a.w + b.w > 0.0f)) & ((1 << n) - 1);
    // Most limits are kept.
    for (; over; over &= over - 1) {
        int l = __builtin_ctz(over);
        float wi = a.w[l], wj = b.w[l], w = wi + wj;
        f4 pull = (f4){d.x[l], d.y[l], d.z[l], 0.0f} * ((most[l] - length[l]) / (length[l] * w));
        node[I[l]] += pull * wi;
        node[J[l]] -= pull * wj;
        if (wi == 0.0f) lane::set_row3(reaction.data, I[l], lane::row3(reaction.data, I[l]) + pull);
        if (wj == 0.0f) lane::set_row3(reaction.data, J[l], lane::row3(reaction.data, J[l]) - pull);
    }
};
FOR_EACH_COLOUR(project)
lane::unpack(node, centre.data, centre.shape[0]);
""",
)

move_with_nodes = make_twin(
    coarse.move_with_nodes,
    """
// By what each node has moved; the entry before the first is for no node.
f4_any* shift = (f4_any*)scratch.data + 1;
shift[-1] = 0.0f;
for (int c = 0; c < centre.shape[0]; c++)
    shift[c] = lane::row3(centre.data, c) - lane::row3(centre_before.data, c);
for (int i = 0; i < count; i++) {
    f4 pull = 0.0f;
    if (inverse_mass.data[i] != 0.0f) {
        const int* node = (const int*)(nodes.data + i);
        f4 weight = lane::row4(weights.data, i);
        if (is_stuck.data[i] != 0) {
            for (int k = 0; k < 4; k++)
                if (node[k] >= 0)
                    pull += lane::row3(reaction.data, node[k])
                        * (weight[k] * node_inverse_mass.data[node[k]] / held.data[node[k]]);
        } else {
            f4 moved = weight.x * shift[node[0]];
            moved += weight.y * shift[node[1]];
            moved += weight.z * shift[node[2]];
            moved += weight.w * shift[node[3]];
            float length = __builtin_sqrtf(
                moved.x * moved.x + moved.y * moved.y + moved.z * moved.z);
            if (length > farthest) moved *= farthest / length;
            lane::set_row3(position.data, i, lane::row3(position.data, i) + moved);
        }
    }
    lane::set_row3(tension.data, i, pull);
}
""",
)
