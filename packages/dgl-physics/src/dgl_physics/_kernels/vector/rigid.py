"""Twin of `_kernels.rigid.solve_rigid_contact`."""

from dgl_physics._kernels import rigid
from dgl_physics._kernels.distance import PLANE
from dgl_physics._kernels.vector.twin import make_twin

solve_rigid_contact = make_twin(
    rigid.solve_rigid_contact,
    f"const int PLANE = {int(PLANE)};"
    """
// Particles near nothing, or near one fixed plane (the ground), are solved here, eight of one
// garment at a time. The others are left over.
int left = 0, planes = 0, ground = 0;
for (int s = 0; s < shapes.kind.shape[0]; s++)
    if (shapes.kind.data[s] == PLANE) planes++, ground = s;
bool is_still = planes == 1 && !shapes.is_moving.data[ground] && !shapes.is_measured.data[ground];
const i8 own = {0, 1, 2, 3, 4, 5, 6, 7};
for (int i = 0; i < count; i += 8) {
    int n = i + 8 <= count ? 8 : count - i, last = i + n - 1;
    int e = i / particles_per_env, kind = garment.data[i];
    bool is_alike = last / particles_per_env == e && garment.data[last] == kind;
    auto m = materials.data[kind];
    f8 w = lane::some(inverse_mass.data + i, n);
    i8 shapes_near = lane::some(near_count.data + i, n), torn = lane::some(is_torn.data + i, n);
    i8 acts = (own < n) & (w != 0.0f);
    i8 meets = shapes_near > 0;
    i8 is_alike_all = is_alike ? -1 : 0, is_still_all = is_still ? -1 : 0;
    i8 takes = acts & (lane::some(near_bodies.data + i, n) == 0) & is_alike_all;
    takes = takes & ((shapes_near == 0) | is_still_all);
    for (int rest = lane::bits(acts & ~takes); rest; rest &= rest - 1)
        scratch.data[left++] = i + __builtin_ctz(rest);
    lane::put(is_torn.data + i, acts & ~takes ? torn : 0, n);
    int taken = lane::bits(takes);
    if (taken == 0) continue;
    i8 slips = torn == 1;
    meets = meets & takes & (m.is_solid == 0 ? -1 : 0);

    f8x3 before = lane::some3(previous.data + i, n), v = lane::some3(velocity.data + i, n);
    f8x3 x = lane::some3(position.data + i, n);
    f8x3 predicted = {before.x + v.x * dt, before.y + v.y * dt, before.z + v.z * dt};
    f8 zero = 0.0f;
    f8x3 pushed = {zero, zero, zero};
    i8 stuck = 0;
    if (lane::bits(meets)) {
        int plane = near.data[(i + __builtin_ctz(lane::bits(meets))) * limits.near_capacity];
        wp::transform pose = pose_now.data[e * pose_now.shape[1] + plane];
        auto q = pose.q;
        wp::vec3 up = wp::quat_rotate(q, wp::vec3(0.0f, 0.0f, 1.0f));
        f8x3 normal = {lane::all(up[0]), lane::all(up[1]), lane::all(up[2])};
        f8x3 r = {x.x - pose.p[0], x.y - pose.p[1], x.z - pose.p[2]};
        f8 turned = 2.0f * (q.x * r.x + q.y * r.y + q.z * r.z);
        f8 distance = r.z * (2.0f * q.w * q.w - 1.0f) + q.z * turned
            - (q.x * r.y - q.y * r.x) * q.w * 2.0f;
        f8 gap = distance - m.rest_offset;
        meets = meets & (gap < m.adhesion_radius);
        i8 inside = meets & (gap < 0.0f);
        f8x3 slip = {x.x - before.x, x.y - before.y, x.z - before.z};
        f8 along = lane::dot(normal, slip);
        slip = {slip.x - normal.x * along, slip.y - normal.y * along, slip.z - normal.z * along};
        f8 held = -lane::min(m.adhesion * w * dt * dt, lane::all(1.0f)) * gap;
        f8 push = inside ? -gap : held;
        f8 support = inside ? push : -push;
        f8x3 pull = lane::some3(tension.data + i, n), squeezed = lane::some3(squeeze.data + i, n);
        along = lane::dot(normal, pull);
        f8 pressed = -lane::min(lane::dot(normal, squeezed), zero) * (m.stiffening * dt * dt);
        support = push > 0.0f ? lane::max(support - along, zero) + pressed : support;
        f8x3 wanted = {slip.x + pull.x - normal.x * along, slip.y + pull.y - normal.y * along,
                       slip.z + pull.z - normal.z * along};
        f8 length = lane::sqrt(lane::dot(wanted, wanted));
        f8 limit = slips ? zero : m.friction * shapes.friction.data[ground] * support;
        i8 slides = length > limit;
        f8 kept = slides ? lane::min(limit / (slides ? length : 1.0f), lane::all(1.0f)) : 1.0f;
        stuck = meets & ~slides & (push > 0.0f);
        x = {meets ? x.x + normal.x * push - slip.x * kept : x.x,
             meets ? x.y + normal.y * push - slip.y * kept : x.y,
             meets ? x.z + normal.z * push - slip.z * kept : x.z};
        pushed = {inside ? normal.x : zero, inside ? normal.y : zero, inside ? normal.z : zero};
    }
    v = {v.x + (x.x - predicted.x) / dt, v.y + (x.y - predicted.y) / dt,
         v.z + (x.z - predicted.z) / dt};
    f8 leaving = lane::max(lane::dot(v, pushed) - limits.separation_speed, zero);
    v = {v.x - pushed.x * leaving, v.y - pushed.y * leaving, v.z - pushed.z * leaving};
    f8 speed = lane::sqrt(lane::dot(v, v));
    i8 races = speed > limits.max_speed;
    f8 slower = races ? limits.max_speed / (races ? speed : 1.0f) : 1.0f;
    v = {v.x * slower, v.y * slower, v.z * slower};
    lane::put3(position.data + i, x, taken);
    lane::put3(velocity.data + i, v, taken);
    i8 sticks = lane::some(is_stuck.data + i, n);
    lane::put(is_stuck.data + i, takes ? stuck & 1 : sticks, n);
}
return left;
""",
    rest=rigid.resolve_rigid_contact,
)
