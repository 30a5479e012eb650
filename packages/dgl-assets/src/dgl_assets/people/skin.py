"""The skin of a person: a closed mesh and the weights by which it follows the bones."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from dgl_assets.errors import MeshingError
from dgl_assets.garments.meshing import compute_edges, compute_vertex_normals
from dgl_assets.people.body_plan import BodyPlan
from dgl_assets.people.solids import Loft
from dgl_assets.people.surface_nets import evaluate_on_grid, extract_surface, project, separate

_COARSE, _MIDDLE, _FINE = 0.017, 0.011, 0.0048  # grid of a man [m]
_FINENESS = (1.0, 0.88, 1.1, 0.78)  # of the fine parts, tried in turn until fingers are separate
_MARGIN = 0.03
_RAMP = 0.06  # over which the grid bends into the direction of the arms [m]
_CARVING_EDGE = 0.010  # [m]
_MOST_BONES = 6
_SPREAD = 0.8  # how far weights of two bones mix, of the radius of the limb


def make_skin(plan: BodyPlan) -> tuple[np.ndarray, np.ndarray]:
    """Mesh the surface of a body.

    Returns:
        Vertices [m], shape (V, 3), rest pose, and triangles, counter-clockwise from outside, shape
        (F, 3), int32: one closed manifold.

    Raises:
        MeshingError: If the surface is no closed manifold without handles, as where fingers touch.
    """
    failure = ""
    for fineness in _FINENESS:
        vertices, faces = _mesh(plan, fineness)
        edges, counts = compute_edges(faces)
        characteristic = len(vertices) - len(edges) + len(faces)
        if characteristic == 2 and (counts == 2).all():
            return vertices, faces
        failure = (
            f"{int(np.count_nonzero(counts != 2))} edges that are not shared by 2 triangles and an "
            f"Euler characteristic of {characteristic} instead of 2"
        )
    raise MeshingError(f"the skin must be closed and without handles; got {failure}")


def _mesh(plan: BodyPlan, fineness: float) -> tuple[np.ndarray, np.ndarray]:
    slope, start = _find_bend(plan)

    def unbend(grid: np.ndarray) -> np.ndarray:
        points = grid.copy()
        points[..., 2] -= slope * _ramp(np.abs(grid[..., 0]) - start, _RAMP * plan.scale)
        return points

    axes = _make_axes(plan, slope, start, fineness)
    values = evaluate_on_grid(plan.body, axes, unbend)
    vertices, faces = extract_surface(separate(values), axes)
    vertices = project(plan.body, unbend(vertices), step=0.004 * plan.scale)
    vertices = _carve(plan, vertices, faces)
    vertices[:, 2] = np.maximum(vertices[:, 2], 0.0)  # soles are flat
    return _keep_largest(vertices, faces)


def _find_bend(plan: BodyPlan) -> tuple[float, float]:
    """Slope of the arms, and the x of their beginning [m]."""
    names = plan.skeleton.names
    shoulder = plan.skeleton.positions[names.index("left_shoulder")]
    wrist = plan.skeleton.positions[names.index("left_wrist")]
    run, fall = wrist[0] - shoulder[0], shoulder[2] - wrist[2]
    return float(fall / run), float(shoulder[0] - 0.5 * _RAMP * plan.scale)


def _ramp(x: np.ndarray, width: float) -> np.ndarray:
    """0 below 0, x - width / 2 above `width`, smooth between."""
    inside = np.clip(x, 0.0, width)
    return inside**2 / (2 * width) + np.maximum(x - width, 0.0)


def _make_axes(
    plan: BodyPlan, slope: float, start: float, fineness: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    names, positions = plan.skeleton.names, plan.skeleton.positions
    low, high = plan.body.bounds()
    margin, scale = _MARGIN * plan.scale, plan.scale
    wrist = positions[names.index("left_wrist")]
    level = wrist[2] + slope * float(_ramp(np.array(wrist[0] - start), _RAMP * scale))
    hand = [plan.points[name] for name in plan.points if name.startswith("left_") and "tip" in name]
    fingers = np.stack([p for p in hand if p[2] < wrist[2] and p[0] > wrist[0]])
    chin = plan.points["chin"][2]
    face = 0.6 * (plan.points["left_temple"][0] - plan.points["right_temple"][0])

    def size_x(x: float) -> float:
        if abs(x) > wrist[0] - 0.02 * scale:
            return fineness * _FINE
        return 0.8 * _MIDDLE if abs(x) < face else _COARSE

    def size_y(y: float) -> float:
        near = 0.015 * scale
        return (
            fineness * _FINE
            if fingers[:, 1].min() - near < y < fingers[:, 1].max() + near
            else _MIDDLE
        )

    def size_z(z: float) -> float:
        if abs(z - level) < 0.035 * scale:
            return fineness * _FINE
        return 0.75 * _MIDDLE if z > chin - 0.02 * scale else _COARSE

    half = _divide(0.0, float(high[0] + margin), size_x, scale)
    x = np.concatenate([-half[:0:-1], half])
    y = _divide(float(low[1] - margin), float(high[1] + margin), size_y, scale)
    z = _divide(-margin, float(high[2] + margin), size_z, scale)
    return x, y, z


def _divide(low: float, high: float, size: Callable[[float], float], scale: float) -> np.ndarray:
    """Place nodes whose distance follows `size` without jumps."""
    nodes, step = [low], size(low)
    while nodes[-1] < high:
        ahead = min(size(nodes[-1] + k * step * scale) for k in (0, 2, 4))
        step += np.clip(ahead - step, -0.25 * step, 0.15 * step)
        nodes.append(nodes[-1] + step * scale)
    return np.array(nodes)


def _carve(plan: BodyPlan, vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Press hollows into the surface along its normals."""
    normals = compute_vertex_normals(vertices, faces)
    depth = np.zeros(len(vertices))
    edge = _CARVING_EDGE * plan.scale
    for solid in plan.carving:
        inside = edge - solid.distance(vertices)
        depth = np.maximum(depth, np.where(inside > 0, inside**2 / (4 * edge), 0.0))
    return vertices - np.minimum(depth, edge)[:, None] * normals


def _keep_largest(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    count = len(vertices)
    pairs = np.concatenate([faces[:, :2], faces[:, 1:]])
    graph = sparse.coo_matrix((np.ones(len(pairs)), pairs.T), shape=(count, count))
    _, labels = sparse.csgraph.connected_components(graph, directed=False)
    kept = labels == np.argmax(np.bincount(labels))
    index = np.cumsum(kept) - 1
    return vertices[kept], index[faces[kept[faces[:, 0]]]].astype(np.int32)


def compute_weights(plan: BodyPlan, vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Compute skinning weights.

    Each vertex begins with the bone of the nearest solid. Weights then diffuse over the surface, as
    far as the limb is thick, so that no weight jumps from one finger to the next.

    Args:
        plan: The body.
        vertices: Skin [m], shape (V, 3), rest pose.
        faces: Triangles, shape (F, 3).

    Returns:
        Weights, shape (V, J), rows sum to 1, at most six a vertex are not 0.
    """
    bones, radii = _assign_bones(plan, vertices)
    joint_count = len(plan.skeleton.joints)
    start = np.zeros((len(vertices), joint_count))
    start[np.arange(len(vertices)), bones] = 1.0
    edges, _ = compute_edges(faces)
    lengths = np.linalg.norm(vertices[edges[:, 1]] - vertices[edges[:, 0]], axis=1)
    reach = _SPREAD * radii[edges].mean(axis=1)
    flow = (reach / lengths) ** 2 / 3  # about six edges a vertex: variance 2 reach^2 in the plane
    n = len(vertices)
    matrix = sparse.coo_matrix((flow, (edges[:, 0], edges[:, 1])), shape=(n, n))
    matrix = matrix + matrix.T
    system = sparse.diags(1 + np.asarray(matrix.sum(axis=1)).ravel()) - matrix
    solve = splu(system.tocsc(), permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True})
    weights = np.clip(solve.solve(start), 0.0, None)
    keep = np.argpartition(-weights, _MOST_BONES, axis=1)[:, :_MOST_BONES]
    sparse_weights = np.zeros_like(weights)
    rows = np.arange(n)[:, None]
    sparse_weights[rows, keep] = weights[rows, keep]
    sparse_weights[sparse_weights < 1e-4] = 0.0
    return sparse_weights / sparse_weights.sum(axis=1, keepdims=True)


def _assign_bones(plan: BodyPlan, vertices: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Bone of each vertex, shape (V,), and the radius of the limb there [m], shape (V,)."""
    index = {name: k for k, name in enumerate(plan.skeleton.names)}
    best = np.full(len(vertices), np.inf)
    bones = np.zeros(len(vertices), dtype=int)
    radii = np.zeros(len(vertices))
    for solid in plan.body.list_solids():
        distance = solid.distance(vertices)
        if isinstance(solid, Loft):
            own = np.array([index[name] for name in solid.bones])
            bone = own[np.searchsorted(np.array(solid.borders), vertices[:, 2])]
            radius = np.interp(vertices[:, 2], solid.heights, solid.half_depths)
        else:
            bone, radius = np.full(len(vertices), index[solid.bone]), float(np.mean(solid.radii))
        nearer = distance < best
        best = np.where(nearer, distance, best)
        bones = np.where(nearer, bone, bones)
        radii = np.where(nearer, radius, radii)
    return bones, radii
