"""The coarse level of a garment: patches of cloth and the limits of their distances."""

from collections import deque
from dataclasses import dataclass

import numpy as np
import warp as wp

from dgl_physics import topology
from dgl_physics.membrane import MembraneModuli, compute_tensile_modulus

PARTICLES_PER_NODE = 16
"""Particles of the mesh for each node of the coarse level."""
SMOOTHINGS = 3
"""Averagings with the neighbours that make the patches overlap."""
WEIGHTS = 4
"""Nodes that a particle belongs to, at most."""
SMALLEST_PANEL = 48
"""Panels of fewer particles get no coarse level: their constraints converge alone."""
DETOUR = 1.25
"""A limit is left out where the way through the cloth is longer than the straight one by this."""


SOFTEST = 200.0
"""Directions in which the cloth is softer than this [N/m] are left to its own constraints, which
converge there."""
FREE_TENSION = 2.0
"""Limits leave the strain that belongs to this tension [N/m] to the cloth's own constraints."""


@dataclass(frozen=True)
class CoarseLevel:
    """Overlapping patches of one garment and the limits of their distances.

    The centres of two patches of inextensible cloth cannot be farther apart than when it is spread
    out flat. These limits carry weight over many particles at once; constraints along edges carry
    it by one edge a pass.

    Attributes:
        nodes: Patches of each particle, shape (V, 4), int32; -1 for none.
        weights: Its weights in them, shape (V, 4), float32; their sum is 1, or all are 0.
        pairs: Nodes with a limit between them, shape (L, 2), int32.
        lengths: Largest distance of their centres [m], shape (L,), float32.
        node_count: Number of nodes.
        masses: Masses of the particles [kg], shape (V,).
    """

    nodes: np.ndarray
    weights: np.ndarray
    pairs: np.ndarray
    lengths: np.ndarray
    node_count: int
    masses: np.ndarray


def build_coarse_level(
    rest: np.ndarray, faces: np.ndarray, masses: np.ndarray, moduli: MembraneModuli
) -> CoarseLevel:
    """Build the coarse level of a garment; panels may lie on each other at rest.

    Rest positions are in metres, shape (V, 3), faces have shape (F, 3), masses [kg] shape (V,).
    """
    hinges = topology.compute_hinges(faces)
    hinges = hinges[topology.is_flat_hinge(rest, hinges)]
    panel = topology.label_panels(faces, hinges)
    membership = np.zeros((len(rest), 0), dtype=np.float32)
    node_panel: list[int] = []
    panel_vertices = [np.unique(faces[panel == p]) for p in range(panel.max() + 1)]
    for p in range(len(panel_vertices)):
        own_faces, vertices = faces[panel == p], panel_vertices[p]
        if len(vertices) < SMALLEST_PANEL:
            continue
        part = np.zeros((len(rest), max(len(vertices) // PARTICLES_PER_NODE, 1)), np.float32)
        part[vertices] = _spread_patches(np.searchsorted(vertices, own_faces), part.shape[1])
        membership = np.concatenate([membership, part], axis=1)
        node_panel += [p] * part.shape[1]
    if not node_panel:
        return make_empty_coarse_level(masses)
    nodes, weights = _keep_largest(membership)
    membership[:] = 0.0
    particle, slot = np.nonzero(nodes >= 0)
    membership[particle, nodes[particle, slot]] = weights[particle, slot]
    centres, pairs, lengths = _limit_pairs(
        rest, faces, masses, membership, np.array(node_panel), panel_vertices
    )
    across = centres[pairs[:, 1]] - centres[pairs[:, 0]]
    modulus = compute_tensile_modulus(moduli, np.arctan2(across[:, 1], across[:, 0]))
    is_stiff = modulus >= SOFTEST
    pairs = pairs[is_stiff]
    lengths = (lengths * (1 + FREE_TENSION / modulus))[is_stiff].astype(np.float32)
    return CoarseLevel(nodes, weights, pairs, lengths, len(node_panel), masses)


def make_empty_coarse_level(masses: np.ndarray) -> CoarseLevel:
    """Make a coarse level without nodes, for solids and small panels."""
    nodes = np.full((len(masses), WEIGHTS), -1, dtype=np.int32)
    no_pairs = np.zeros((0, 2), dtype=np.int32)
    return CoarseLevel(nodes, 0.0 * nodes, no_pairs, np.zeros(0), 0, masses)


def _spread_patches(faces: np.ndarray, count: int) -> np.ndarray:
    """Divide a panel into patches that overlap smoothly, shape (V, count), rows adding up to 1."""
    edges = topology.compute_edges(faces)
    vertex_count = int(faces.max()) + 1
    start, neighbours = topology.compute_adjacency(edges, vertex_count)
    owner = _divide(start, neighbours, count)
    membership = np.zeros((vertex_count, count), dtype=np.float32)
    membership[np.arange(vertex_count), owner] = 1.0
    degree = np.diff(start)[:, None]
    for _ in range(SMOOTHINGS):
        around = np.add.reduceat(membership[neighbours], start[:-1], axis=0)
        membership = (membership + around) / (degree + 1)
    return membership


def _divide(start: np.ndarray, neighbours: np.ndarray, count: int) -> np.ndarray:
    """Divide a graph by the nearest of seeds that are as far from each other as possible."""
    vertex_count = len(start) - 1
    bounds, around = start.tolist(), neighbours.tolist()  # quicker than arrays, item by item
    distance, owner = [vertex_count] * vertex_count, [0] * vertex_count
    for k in range(count):
        seed = distance.index(max(distance))
        distance[seed], owner[seed] = 0, k
        queue = deque([seed])
        while queue:
            i = queue.popleft()
            further = distance[i] + 1
            for j in around[bounds[i] : bounds[i + 1]]:
                if further < distance[j]:
                    distance[j], owner[j] = further, k
                    queue.append(j)
    return np.array(owner)


def _keep_largest(membership: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Keep the largest weights of each row, scaled to add up to 1; -1 where there is none."""
    short = max(WEIGHTS - membership.shape[1], 0)
    padded = np.pad(membership, ((0, 0), (0, short)))
    nodes = np.argsort(-padded, axis=1, kind="stable")[:, :WEIGHTS]
    weights = np.take_along_axis(padded, nodes, axis=1)
    total = weights.sum(axis=1, keepdims=True)
    weights = np.divide(weights, total, out=np.zeros_like(weights), where=total > 0)
    return np.where(weights > 0, nodes, -1).astype(np.int32), weights


def _limit_pairs(
    rest: np.ndarray,
    faces: np.ndarray,
    masses: np.ndarray,
    membership: np.ndarray,
    node_panel: np.ndarray,
    panel_vertices: list[np.ndarray],
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Find the pairs of nodes with a limit: neighbours and their neighbours."""
    count = membership.shape[1]
    weight = membership * masses[:, None]
    weight = weight / np.maximum(weight.sum(axis=0), 1e-12)
    centre = weight.T @ rest
    normal = weight.T @ topology.compute_vertex_normals(rest, faces)
    normal = normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-9)

    def measure(pairs: np.ndarray) -> np.ndarray:
        return _measure_unfolded(pairs, centre, normal, node_panel, rest, panel_vertices)

    owner = np.where(membership.any(axis=1), membership.argmax(axis=1), -1)
    near = owner[topology.compute_edges(faces)]
    near = near[(near[:, 0] != near[:, 1]) & (near.min(axis=1) >= 0)]
    near = np.unique(np.sort(near, axis=1), axis=0)
    length = measure(near)
    start, _ = topology.compute_adjacency(near, count)
    both = np.concatenate([near, near[:, ::-1]])
    order = np.lexsort((both[:, 1], both[:, 0]))
    both, step = both[order], np.tile(length, 2)[order]
    # all paths of two steps, a to b to c, and the shortest for each pair
    degree = np.diff(start)[both[:, 1]]
    first = np.repeat(np.arange(len(both)), degree)
    second = np.repeat(start[both[:, 1]] - np.cumsum(degree) + degree, degree)
    second = second + np.arange(len(first))
    ends = np.column_stack([both[first, 0], both[second, 1]])
    way = step[first] + step[second]
    is_once = ends[:, 0] < ends[:, 1]
    ends, inverse = np.unique(ends[is_once], axis=0, return_inverse=True)
    shortest = np.full(len(ends), np.inf)
    np.minimum.at(shortest, inverse.ravel(), way[is_once])
    straight = measure(ends)
    is_far = ~(ends[:, None] == near[None]).all(axis=2).any(axis=1)
    keep = is_far & (shortest <= DETOUR * straight)
    pairs = np.concatenate([near, ends[keep]]).astype(np.int32)
    return centre, pairs, np.concatenate([length, straight[keep]])


def _measure_unfolded(
    pairs: np.ndarray,
    centre: np.ndarray,
    normal: np.ndarray,
    node_panel: np.ndarray,
    rest: np.ndarray,
    panel_vertices: list[np.ndarray],
) -> np.ndarray:
    """Measure the distance of nodes when the cloth between them is flat [m], shape (L,).

    Within a panel it is straight, or along an arc where the panel is curved at rest; between two
    panels it is over their seam, about which one of them is turned.
    """
    a, b = pairs.T
    length = np.linalg.norm(centre[a] - centre[b], axis=1)
    half = 0.5 * np.arccos(np.clip(np.sum(normal[a] * normal[b], axis=1), 0.0, 1.0))
    length = length / np.maximum(np.sinc(half / np.pi), 0.5)
    seams: dict[tuple[int, int], np.ndarray] = {}  # many pairs of nodes are of the same two panels
    for k in np.flatnonzero(node_panel[a] != node_panel[b]):
        p, q = int(node_panel[a[k]]), int(node_panel[b[k]])
        if (p, q) not in seams:
            seams[p, q] = rest[np.intersect1d(panel_vertices[p], panel_vertices[q])]
        seam = seams[p, q]
        if len(seam):
            over = np.linalg.norm(seam - centre[a[k]], axis=1)
            over = over + np.linalg.norm(seam - centre[b[k]], axis=1)
            length[k] = over.min()
        else:
            length[k] = np.inf
    return length


@dataclass(frozen=True)
class CoarseTable:
    """Coarse levels of all garments of all environments, on one device."""

    node_count: int
    node_start: wp.array
    node_particle: wp.array
    node_weight: wp.array
    """Share of a particle in its node's centre of mass."""
    node_inverse_mass: wp.array
    nodes: wp.array
    weights: wp.array
    pairs: wp.array
    limit: wp.array
    colour_start: tuple[int, ...]
    """First limit of each colour, and the end of the last."""


def join_coarse_levels(
    levels: list[tuple[int, CoarseLevel]], particle_count: int, device: str
) -> CoarseTable:
    """Join the coarse levels of garments, each given with its first particle."""
    nodes = np.full((particle_count, WEIGHTS), -1, dtype=np.int32)
    weights = np.zeros((particle_count, WEIGHTS), dtype=np.float32)
    masses = np.zeros(particle_count)
    pairs, limits, colours = [], [], []
    node_count = 0
    for first, level in levels:
        end = first + len(level.nodes)
        nodes[first:end] = np.where(level.nodes >= 0, level.nodes + node_count, -1)
        weights[first:end] = level.weights
        masses[first:end] = level.masses
        pairs.append(level.pairs + node_count)
        limits.append(level.lengths)
        colours.append(topology.colour_constraints(level.pairs, level.node_count))
        node_count += level.node_count
    pair, limit, colour = (np.concatenate(part) for part in (pairs, limits, colours))
    order, colour_start = topology.sort_by_colour(colour)

    particle, slot = np.nonzero(nodes >= 0)
    node = nodes[particle, slot]
    by_node = np.lexsort((particle, node))
    particle, slot, node = particle[by_node], slot[by_node], node[by_node]
    mass = weights[particle, slot] * masses[particle]
    total = np.bincount(node, mass, minlength=node_count)
    start = np.concatenate([[0], np.cumsum(np.bincount(node, minlength=node_count))])

    def to_device(values: np.ndarray, dtype: type) -> wp.array:
        return wp.array(np.ascontiguousarray(values), dtype=dtype, device=device)

    return CoarseTable(
        node_count=node_count,
        node_start=to_device(start, wp.int32),
        node_particle=to_device(particle, wp.int32),
        node_weight=to_device(mass / total[node], wp.float32),
        node_inverse_mass=to_device(1.0 / np.maximum(total, 1e-12), wp.float32),
        nodes=to_device(nodes, wp.vec4i),
        weights=to_device(weights, wp.vec4),
        pairs=to_device(pair[order], wp.vec2i),
        limit=to_device(limit[order], wp.float32),
        colour_start=colour_start,
    )
