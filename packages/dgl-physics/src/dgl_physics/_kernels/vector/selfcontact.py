"""Twins of `_kernels.selfcontact`: contact of particles with particles.

Lists of neighbours are read eight at a time, so the array has eight spare entries at its end.
"""

from dgl_physics._kernels import selfcontact
from dgl_physics._kernels.vector.twin import make_twin

solve_self_contact = make_twin(
    selfcontact.solve_self_contact,
    f"const float LOFT = {float(selfcontact.LOFT)}f, CROWDED = {float(selfcontact.CROWDED)}f;"
    f"const float UNDONE = {float(selfcontact.UNDONE)}f;"
    """
// Of each particle: position, radius; motion, crowd; inverse mass, friction, adhesion, radius.
f4_any* place = (f4_any*)scratch.data;
f4_any* moved = place + count;
f4_any* nature = moved + count;
float stickiest = 0.0f;
for (int i = 0; i < count; i++) {
    f4 x = lane::row3(position.data, i), d = x - lane::row3(previous.data, i);
    f4 t = lane::row4(touch.data, i);
    stickiest = t.w > stickiest ? t.w : stickiest;
    place[i] = (f4){x.x, x.y, x.z, t.x};
    moved[i] = (f4){d.x, d.y, d.z, crowd.data[i]};
    nature[i] = (f4){inverse_mass.data[i], t.y, t.z, t.w};
}
// Sums of each particle, apart for pairs in which it comes first and second: corrections, shares in
// contacts, and squeeze. They are added up in the order of the kernel's threads.
f8_any* first = (f8_any*)(nature + count);
f8_any* second = first + count;
for (int i = 0; i < 2 * count; i++) first[i] = 0.0f;

const int ROOM = 512;
int I[ROOM + 8], J[ROOM + 8];
int found = 0;
auto solve = [&](int k, int n) __attribute__((always_inline)) {
    int* at = I + k;
    int* to = J + k;
    f8x4 a = lane::rows4(place, at), b = lane::rows4(place, to);
    f8x4 va = lane::rows4(moved, at), vb = lane::rows4(moved, to);
    f8x4 own = lane::rows4(nature, at), other = lane::rows4(nature, to);
    f8 wi = own.x, wj = other.x;
    f8x3 d = {a.x - b.x, a.y - b.y, a.z - b.z};
    f8 thickness = a.w + b.w, reach = thickness + lane::max(own.w, other.w);
    f8 r2 = lane::dot(d, d);
    i8 near = (r2 < reach * reach) & (r2 >= 1.0e-16f) & (wi + wj != 0.0f);
    f8 r = lane::sqrt(near ? r2 : 1.0f), s = 1.0f / r;
    f8x3 normal = {d.x * s, d.y * s, d.z * s};
    f8 depth = thickness - r;
    f8x3 slip = {va.x - vb.x, va.y - vb.y, va.z - vb.z};
    f8 along = lane::dot(normal, slip), before = depth + along;
    f8 inertia = 1.0f / lane::max(wi + wj, lane::all(1.0e-9f));
    f8 zero = 0.0f, crowding = lane::max(lane::all(1.0f), CROWDED * lane::max(va.w, vb.w));
    i8 deep = near & (depth > 0.0f), meets = near & ((depth > 0.0f) | (before > 0.0f));

    f8 old = lane::max(before, zero);
    f8 push = lane::min(lane::max(UNDONE * old - along, -old), lane::max(depth, zero));
    slip = {slip.x - normal.x * along, slip.y - normal.y * along, slip.z - normal.z * along};
    f8 limit = 0.5f * (own.y + other.y) * lane::max(push, zero), length2 = lane::dot(slip, slip);
    i8 slides = length2 > limit * limit;
    f8 kept = slides ? limit / lane::sqrt(slides ? length2 : 1.0f) : 1.0f;
    f8 share = inertia / crowding;
    f8x3 change = {(normal.x * push - slip.x * kept) * share,
                   (normal.y * push - slip.y * kept) * share,
                   (normal.z * push - slip.z * kept) * share};

    f8 adhesion = 0.5f * (own.z + other.z) * dt * dt, pull = depth / crowding;
    f8x3 drawn = {normal.x * pull, normal.y * pull, normal.z * pull};
    f8 ci = meets ? wi : lane::min(adhesion * wi, lane::all(0.1f));
    f8 cj = meets ? wj : lane::min(adhesion * wj, lane::all(0.1f));
    change = {meets ? change.x : drawn.x, meets ? change.y : drawn.y, meets ? change.z : drawn.z};
    ci = near ? ci : 0.0f;
    cj = near ? cj : 0.0f;
    f8 loft = lane::min(depth / (LOFT * thickness), lane::all(1.0f));
    f8 size = deep ? depth * loft * loft : 0.0f;
    f4 rows[8], presses[8];
    lane::back({normal.x * size, normal.y * size, normal.z * size, zero}, presses);
    lane::back({change.x * ci, change.y * ci, change.z * ci, deep ? wi * inertia : 0.0f}, rows);
    for (int l = 0; l < n; l++) first[at[l]] += lane::join(rows[l], presses[l]);
    f8 weight = deep ? wj * inertia : 0.0f;
    lane::back({-(change.x * cj), -(change.y * cj), -(change.z * cj), weight}, rows);
    for (int l = 0; l < n; l++) second[to[l]] += lane::join(rows[l], -presses[l]);
};
auto solve_found = [&](int n) {
    int whole = n / 8 * 8;
    for (int k = 0; k < whole; k += 8) solve(k, 8);
    if (whole < n) {
        for (int k = n; k < whole + 8; k++) I[k] = I[whole], J[k] = J[whole];
        solve(whole, n - whole);
    }
};

// Most listed pairs are out of reach; the others are collected to fill the lanes.
for (int i = 0; i < count; i++) {
    int n = neighbour_count.data[i];
    const int* list = neighbours.data + i * limits.neighbour_capacity;
    f4 x = place[i];
    for (int k = 0; k < n; k += 8) {
        f8x4 b = lane::rows4(place, list + k);
        f8x3 d = {x.x - b.x, x.y - b.y, x.z - b.z};
        f8 reach = x.w + b.w + stickiest;
        int bits = lane::bits(lane::dot(d, d) < reach * reach);
        if (k + 8 > n) bits &= (1 << (n - k)) - 1;
        if (found + 8 > ROOM) {
            solve_found(found);
            found = 0;
        }
        lane::store(I + found, (i8)(i));
        lane::store(J + found, lane::compress(lane::load(list + k), bits));
        found += __builtin_popcount(bits);
    }
}
solve_found(found);
for (int i = 0; i < count; i++) {
    f8 total = second[i] + first[i];
    lane::set_row3(correction.data, i, lane::row3(correction.data, i) + total.lo);
    lane::set_row3(squeeze_next.data, i, lane::row3(squeeze_next.data, i) + total.hi);
    crowd_next.data[i] += total.lo.w;
}
""",
)

find_neighbours = make_twin(
    selfcontact.find_neighbours,
    """
// Particles are sorted by cubic cells, x fastest: three cells in a row are one range of particles.
const int row = count + 16;
int* cell_of = scratch.data;
int* joined_to = cell_of + row;
int* near = joined_to + row;
int* begin = near + 9 * row;
struct Places {
    int* index;
    float *x, *y, *z;
    Places(int* at, int row) : index(at), x((float*)at + row), y(x + row), z(y + row) {}
};
Places sorted(near + row, row), around(near + 5 * row, row);
const float* sizes = (const float*)touch.data;
int room = scratch.shape[0] - (int)(begin - scratch.data);
for (int i = 0; i < count; i++) joined_to[i] = -1;
auto row_of = [&](int i) { return lane::row3(position.data, i); };
auto is_counted = [&](int i) {
    f4 x = row_of(i);
    return touch.data[i][0] > 0.0f
        && __builtin_fabsf(x.x) + __builtin_fabsf(x.y) + __builtin_fabsf(x.z) < 1.0e4f;
};

for (int from = 0, to; from < count; from = to) {
    int env = environment.data[from];
    for (to = from; to < count && environment.data[to] == env; to++) {}
    f4 low = 1.0e9f, high = -1.0e9f;
    for (int i = from; i < to; i++)
        if (is_counted(i)) {
            low = __builtin_elementwise_min(low, row_of(i));
            high = __builtin_elementwise_max(high, row_of(i));
        }
    if (low.x > high.x) low = high = 0.0f;
    // With a ring of empty cells around; larger cells where there is no room for so many.
    float size = reach;
    int nx, ny, nz;
    for (;; size *= 1.25f) {
        f4 cells = (high - low) / size;
        if ((cells.x + 3.0f) * (cells.y + 3.0f) * (cells.z + 3.0f) + 3.0f > room) continue;
        nx = (int)cells.x + 3, ny = (int)cells.y + 3, nz = (int)cells.z + 3;
        break;
    }
    int total = nx * ny * nz;
    for (int c = 0; c <= total; c++) begin[c] = 0;
    for (int i = from; i < to; i++) {
        f4 at = (row_of(i) - low) / size;
        int cell = (((int)at.z + 1) * ny + (int)at.y + 1) * nx + (int)at.x + 1;
        cell_of[i] = is_counted(i) ? cell : -1;
        if (cell_of[i] >= 0) begin[cell_of[i] + 1]++;
    }
    for (int c = 0; c < total; c++) begin[c + 1] += begin[c];
    int counted = begin[total];
    for (int i = to - 1; i >= from; i--)
        if (cell_of[i] >= 0) sorted.index[--begin[cell_of[i] + 1]] = i;
    // The particles of a cell now begin at `begin[cell + 1]` and end where the next cell's begin.
    int* first = begin + 1;
    first[total] = counted;
    for (int k = 0; k < counted; k++) {
        int i = sorted.index[k];
        f4 x = row_of(i);
        sorted.x[k] = x.x, sorted.y[k] = x.y, sorted.z[k] = x.z;
    }

    // The particles of a cell share their surroundings, which are copied side by side once.
    int laid_for = -1, laid = 0;
    auto lay_out = [&](int c) {
        laid_for = c, laid = 0;
        for (int dz = -1; dz <= 1; dz++)
            for (int dy = -1; dy <= 1; dy++) {
                const int* range = first + c + (dz * ny + dy) * nx;
                int k = range[-1], end = range[2];
                do {
                    lane::store(around.index + laid, lane::load(sorted.index + k));
                    lane::store(around.x + laid, lane::load(sorted.x + k));
                    lane::store(around.y + laid, lane::load(sorted.y + k));
                    lane::store(around.z + laid, lane::load(sorted.z + k));
                    laid += end - k < 8 ? end - k : 8;
                    k += 8;
                } while (k < end);
            }
        lane::store(around.index + laid, (i8)(-1));
    };
    auto search = [&](int i) {
        f4 x = row_of(i);
        auto hash = [&](float at, unsigned prime) {
            return (unsigned)(int)__builtin_floorf(at / limits.cell_size) * prime;
        };
        unsigned cell = hash(x.x, 73856093u) ^ hash(x.y, 19349663u)
            ^ (hash(x.z, 83492791u) ^ (unsigned)(env * 40960001));
        if (stirred.data[cell & (unsigned)(stirred.shape[0] - 1)] == 0) return;
        lane::set_row3(searched_at.data, i, x);
        neighbour_count.data[i] = 0;
        if (cell_of[i] < 0) return;
        if (cell_of[i] != laid_for) lay_out(cell_of[i]);

        f4 own = lane::row4(touch.data, i);
        int found = 0;
        for (int k = 0; k < laid; k += 8) {
            i8 j = lane::load(around.index + k);
            f8x3 d = {x.x - lane::load(around.x + k), x.y - lane::load(around.y + k),
                      x.z - lane::load(around.z + k)};
            int bits = lane::bits((lane::dot(d, d) < reach * reach) & (j > i));
            lane::store(near + found, lane::compress(j, bits));
            found += __builtin_popcount(bits);
        }
        for (int k = adjacency_start.data[i]; k < adjacency_start.data[i + 1]; k++)
            joined_to[adjacency.data[k]] = i;
        int kept = 0;
        lane::store(near + found, (i8)(i));  // fills the last lanes; its index leaves it out
        for (int q = 0; q < found; q += 8) {
            i8 j = lane::load(near + q);
            f8x3 y = lane::rows3(position.data, near + q);
            f8x3 d = {x.x - y.x, x.y - y.y, x.z - y.z};
            int size[8];
            lane::store(size, 4 * j);
            f8 far = own.x + lane::pick(sizes, size)
                + lane::max(lane::all(own.w), lane::pick(sizes + 3, size))
                + limits.neighbour_margin;
            int bits = lane::bits(
                (lane::dot(d, d) < far * far) & (lane::pick(joined_to, near + q) != i) & (j > i));
            lane::store(near + kept, lane::compress(j, bits));
            kept += __builtin_popcount(bits);
        }
        int* list = neighbours.data + i * limits.neighbour_capacity;
        int listed = kept < limits.neighbour_capacity ? kept : limits.neighbour_capacity;
        lane::store(near + kept, (i8)(count - 1));  // none is greater
        if (kept <= 8 && limits.neighbour_capacity >= 8)
            lane::store(list, lane::sort(lane::load(near)));
        else
            // Each goes to the place given by the number of smaller ones.
            for (int q = 0; q < kept; q++) {
                int smaller = 0;
                for (int k = 0; k < kept; k += 8)
                    smaller += __builtin_popcount(lane::bits(lane::load(near + k) < near[q]));
                if (smaller < listed) list[smaller] = near[q];
            }
        overflow.data[env] += kept - listed;
        neighbour_count.data[i] = listed;
    };
    for (int k = 0; k < counted; k++) search(sorted.index[k]);
    for (int i = from; i < to; i++)
        if (cell_of[i] < 0) search(i);
}
""",
)

apply_corrections = make_twin(
    selfcontact.apply_corrections,
    """
auto move = [&](float* x, float* change, float* now, float* next, int k, int n)
    __attribute__((always_inline)) {
    lane::put(x + k, lane::some(x + k, n) + share * lane::some(change + k, n), n);
    lane::put(now + k, lane::some(next + k, n), n);
    lane::put(change + k, (f8)(0.0f), n);
    lane::put(next + k, (f8)(0.0f), n);
};
float* x = (float*)position.data;
float* change = (float*)correction.data;
float* now = (float*)squeeze.data;
float* next = (float*)squeeze_next.data;
for (int k = 0; k < 3 * count; k += 8)
    if (k + 8 <= 3 * count) move(x, change, now, next, k, 8);
    else move(x, change, now, next, k, 3 * count - k);
for (int i = 0; i < count; i++) {
    float kept = KEPT * crowd.data[i], counted = crowd_next.data[i];
    crowd.data[i] = counted > kept ? counted : kept;
    crowd_next.data[i] = 0.0f;
}
""".replace("KEPT", f"{float(selfcontact.KEPT)}f"),
)
