"""Layers of cloth: pockets on a sheet, and the two sides of a sheet with a thickness."""

from __future__ import annotations

import numpy as np
from scipy.spatial import KDTree

from dgl_assets.importing.errors import BrokenMeshError
from dgl_assets.importing.surface import SurfaceIndex
from dgl_assets.importing.topology import (
    EdgeTable,
    compute_edge_table,
    compute_normals,
    label_components,
)

LARGEST_ATTACHED = 0.25
"""Largest share of the area that parts which lie on the cloth may have, all together."""
_MOST_PATCHES = 500  # between edges of three faces
_MOST_AT_EDGE = 8  # faces
_NEAR = 0.02  # of the diagonal: how far a pocket or an inner side is from the cloth
_INNER_POINTS = 0.8  # of a pocket's vertices that lie over the cloth and not beside it
_SIDES_ALIKE = 0.7  # area of the inner side over that of the outer one
_ASKED = 5000  # faces from which the thickness is found
_PAIRED = 0.75  # of the area of a thick sheet that has another side at the same distance
_OFF = 0.6  # of the thickness that the other side may be off
_OPPOSITE = -0.5  # cosine of normals of the two sides


def drop_attached(
    vertices: np.ndarray, faces: np.ndarray, name: str
) -> tuple[np.ndarray, list[str]]:
    """Keep the sheet where more than two faces meet at an edge, and drop what is sewn onto it.

    Such edges cut the surface into patches. From the largest on, the patch is added that continues
    it straightest, as long as no edge gets a third face.

    Args:
        vertices: Positions, shape (V, 3).
        faces: Triangles of one piece, shape (F, 3), int.
        name: Of the file, for messages.

    Returns:
        Ids of the faces that stay, and what was dropped.

    Raises:
        BrokenMeshError: If that leaves a hole, or drops more than a quarter of the area.
    """
    edges = compute_edge_table(faces)
    crowded = np.flatnonzero(edges.counts > 2)
    if not len(crowded):
        return np.arange(len(faces)), []
    count, patches = label_components(len(faces), edges.faces[edges.counts == 2])
    kept = None
    if count <= _MOST_PATCHES and edges.counts.max() <= _MOST_AT_EDGE:
        kept = _grow_sheet(vertices, faces, edges, patches)
    _, areas = compute_normals(vertices, faces)
    if kept is not None:
        stays = kept[patches]
        share = float(areas[~stays].sum() / areas.sum())
        if share < LARGEST_ATTACHED:
            dropped = int((~stays).sum())
            return np.flatnonzero(stays), [
                f"{dropped} faces in {int((~kept).sum())} parts that are sewn onto the cloth "
                f"(pockets, {share:.1%} of the "
                "area) were dropped"
            ]
    a, b = edges.pairs[crowded[0]]
    place = ", ".join(f"{x:.4g}" for x in vertices[[a, b]].mean(axis=0))
    raise BrokenMeshError(
        f"{name}: {len(crowded)} edges have more than two faces, the first joins vertices {a} and "
        f"{b} near "
        f"({place}) and has {edges.counts[crowded[0]]}; which faces are the cloth cannot be told: "
        "remove the others, or "
        "make them an object of their own and choose with `object`"
    )


def _grow_sheet(
    vertices: np.ndarray, faces: np.ndarray, edges: EdgeTable, patches: np.ndarray
) -> np.ndarray | None:
    """Choose patches that form one sheet with two faces at each crowded edge.

    Returns:
        Mask of the patches, shape (P,), bool; None if there is no such choice.
    """
    is_crowded = edges.counts > 2
    place = np.flatnonzero(is_crowded[edges.face_edges.ravel()])
    face, side = np.divmod(place, 3)
    edge = np.unique(edges.face_edges.ravel()[place], return_inverse=True)[1].reshape(-1)
    ends = vertices[np.stack([faces[face, side], faces[face, (side + 1) % 3]], axis=1)]
    along = ends[:, 1] - ends[:, 0]
    length = np.maximum(np.linalg.norm(along, axis=1), 1e-300)
    inward = vertices[faces[face, (side + 2) % 3]] - ends[:, 0]
    along /= length[:, None]
    inward -= (inward * along).sum(axis=1)[:, None] * along
    inward /= np.maximum(np.linalg.norm(inward, axis=1), 1e-300)[:, None]
    patch, count = patches[face], patches.max() + 1
    _, areas = compute_normals(vertices, faces)
    kept = np.zeros(count, dtype=bool)
    kept[np.argmax(np.bincount(patches, areas))] = True
    while True:
        there = np.bincount(edge[kept[patch]], minlength=edge.max() + 1)
        if there.max() > 2:
            return None
        # What continues at each edge with one kept face, and how straight.
        onward = np.zeros((edge.max() + 1, 3))
        np.add.at(onward, edge[kept[patch]], inward[kept[patch]])
        open_side = ~kept[patch] & (there[edge] == 1)
        straight = -(onward[edge] * inward).sum(axis=1) * length
        own = np.zeros((count, 2))
        np.add.at(own, patch[open_side], np.column_stack([straight, length])[open_side])
        fits = np.ones(count, dtype=bool)
        pairs, sizes = np.unique(np.column_stack([patch, edge]), axis=0, return_counts=True)
        full = there[pairs[:, 1]] + sizes > 2
        fits[pairs[full & ~kept[pairs[:, 0]], 0]] = False
        candidates = np.flatnonzero(fits & ~kept & (own[:, 1] > 0))
        if not len(candidates):
            return None if (there == 1).any() else kept
        kept[candidates[np.argmax(own[candidates, 0] / own[candidates, 1])]] = True


def lies_on(vertices: np.ndarray, main: np.ndarray, piece: np.ndarray) -> bool:
    """Say whether a piece lies on another one, as a pocket does.

    Args:
        vertices: Positions, shape (V, 3).
        main: Triangles of the larger one, shape (F, 3), int.
        piece: Triangles of the other one, shape (G, 3), int.
    """
    distances, is_inner, limit = _compare(vertices, main, piece)
    return bool(distances.max() < limit and is_inner.mean() >= _INNER_POINTS)


def is_inner_side(vertices: np.ndarray, outer: np.ndarray, inner: np.ndarray) -> bool:
    """Tell an inner side: a piece that runs along all of another one and is smaller.

    Two panels that lie on each other have one rim each; what is worn has more.

    Args:
        vertices: Positions, shape (V, 3).
        outer: Triangles of the larger one, shape (F, 3), int.
        inner: Triangles of the other one, shape (G, 3), int.
    """
    areas = [compute_normals(vertices, faces)[1].sum() for faces in (outer, inner)]
    if areas[1] < _SIDES_ALIKE * areas[0]:
        return False
    counts = [_count_rims(faces) for faces in (outer, inner)]
    if counts[0] != counts[1] or counts[0] < 2:
        return False
    there, _, limit = _compare(vertices, outer, inner)
    back, _, _ = _compare(vertices, inner, outer)
    apart = max(there.max(), back.max())
    boxes = [np.ptp(vertices[np.unique(faces)], axis=0) for faces in (outer, inner)]
    return bool(apart < limit and (boxes[1] < boxes[0] + apart).all())


def measure_gap(vertices: np.ndarray, first: np.ndarray, second: np.ndarray) -> float | None:
    """Measure the smallest distance between open edges of two pieces; None without such edges."""
    rims = []
    for faces in (first, second):
        edges = compute_edge_table(faces)
        rims.append(np.unique(edges.pairs[edges.counts == 1]))
    if not all(map(len, rims)):
        return None
    return float(KDTree(vertices[rims[0]]).query(vertices[rims[1]])[0].min())


def take_outer_surface(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, list[str]]:
    """Take the outer side of a garment with a thickness: a closed surface of two sides and rims.

    Most faces of a side have a face of the other side behind them at one distance; the rest are
    rims around the openings. The side that encloses the other one is the outer.

    Args:
        vertices: Positions, shape (V, 3).
        faces: Consistently oriented triangles of one piece, shape (F, 3), int.

    Returns:
        Ids of the faces that stay, and notes. All stay where the surface has openings, or where the
        sides cannot be told.
    """
    everything = np.arange(len(faces))
    edges = compute_edge_table(faces)
    if (edges.counts == 1).any():
        return everything, []
    normals, areas = compute_normals(vertices, faces)
    if _enclosed(vertices, faces) < 0:
        normals = -normals
    thickness, is_side = _find_sides(vertices, faces, normals)
    if float(areas[is_side].sum()) < _PAIRED * float(areas.sum()):
        return everything, []
    inner_edges = edges.faces
    links = inner_edges[is_side[inner_edges].all(axis=1)]
    _, labels = label_components(len(faces), links)
    labels = np.where(is_side, labels, -1)
    sizes = np.bincount(labels[is_side], areas[is_side])
    order = np.argsort(-sizes)[:2]
    if len(order) < 2 or sizes[order].sum() < _PAIRED * areas.sum():
        return everything, []
    if sizes[order[1]] < _SIDES_ALIKE * sizes[order[0]]:
        return everything, []
    sides = [_fill_side(labels, int(label), order, inner_edges) for label in order]
    volumes = [_enclosed(vertices, _turn(faces[side], normals[side], vertices)) for side in sides]
    outer = int(np.argmax(volumes))
    if volumes[0] * volumes[1] >= 0 and _count_rims(faces[sides[outer]]) != 1:
        return everything, []  # of a flat sheet either side will do
    return sides[outer], [
        f"it has a thickness of {thickness:.2g} units; its outer surface was taken, "
        f"{areas[sides[outer]].sum() / areas.sum():.0%} of the area"
    ]


def _compare(
    vertices: np.ndarray, main: np.ndarray, piece: np.ndarray
) -> tuple[np.ndarray, np.ndarray, float]:
    """Measure a piece's vertices from another one: distances, mask of those inside, near points."""
    diagonal = float(np.linalg.norm(np.ptp(vertices[np.unique(main)], axis=0)))
    edges = compute_edge_table(main)
    lengths = np.linalg.norm(vertices[edges.pairs[:, 0]] - vertices[edges.pairs[:, 1]], axis=1)
    surface = SurfaceIndex(vertices, main, spacing=max(float(np.median(lengths)), 1e-3 * diagonal))
    points = vertices[np.unique(piece)]
    found, weights = surface.locate(points)
    distances = np.linalg.norm(surface.evaluate(found, weights) - points, axis=1)
    # On an open edge: the weight of the corner opposite to it is zero.
    is_open = (edges.counts == 1)[edges.face_edges[found]]
    opposite = np.roll(weights, -2, axis=1)
    on_rim = (is_open & (opposite < 1e-6)).any(axis=1)
    return distances, ~on_rim, _NEAR * diagonal


def _count_rims(faces: np.ndarray) -> int:
    edges = compute_edge_table(faces)
    pairs = edges.pairs[edges.counts == 1]
    return len(np.unique(_label_rims(pairs))) if len(pairs) else 0


def _label_rims(pairs: np.ndarray) -> np.ndarray:
    """Label the open edges by the opening that they are of, shape (N,)."""
    ids, place = np.unique(pairs, return_inverse=True)
    _, labels = label_components(len(ids), place.reshape(-1, 2))
    return labels[place.reshape(-1, 2)[:, 0]]


def _find_sides(
    vertices: np.ndarray, faces: np.ndarray, normals: np.ndarray
) -> tuple[float, np.ndarray]:
    """Find the thickness of a closed surface, and the faces with another side at that distance."""
    none = np.zeros(len(faces), dtype=bool)
    diagonal = float(np.linalg.norm(np.ptp(vertices[np.unique(faces)], axis=0)))
    middles = vertices[faces].mean(axis=1)
    edges = compute_edge_table(faces)
    lengths = np.linalg.norm(vertices[edges.pairs[:, 0]] - vertices[edges.pairs[:, 1]], axis=1)
    surface = SurfaceIndex(vertices, faces, spacing=max(float(np.median(lengths)), 1e-3 * diagonal))

    def look(points: np.ndarray, ids: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        found, weights = surface.locate(points, -surface.normals[ids])
        cosine = (surface.normals[found] * surface.normals[ids]).sum(axis=1)
        return surface.evaluate(found, weights), cosine < _OPPOSITE

    some = np.unique(np.linspace(0, len(faces) - 1, _ASKED).astype(int))
    there, is_opposite = look(middles[some], some)
    depth = ((middles[some] - there) * normals[some]).sum(axis=1)
    is_behind = is_opposite & (depth > 0) & (depth < _NEAR * diagonal)
    if is_behind.mean() < 0.5:
        return 0.0, none
    thickness = float(np.median(depth[is_behind]))
    expected = middles - thickness * normals
    there, is_opposite = look(expected, np.arange(len(faces)))
    off = np.linalg.norm(there - expected, axis=1)
    return thickness, is_opposite & (off < _OFF * thickness)


def _fill_side(labels: np.ndarray, label: int, sides: np.ndarray, links: np.ndarray) -> np.ndarray:
    """Faces of a side, with the left-over patches that touch no other side."""
    is_left = ~np.isin(labels, sides)
    _, patches = label_components(len(labels), links[is_left[links].all(axis=1)])
    touches: dict[int, set[int]] = {}
    for first, second in ((0, 1), (1, 0)):
        mixed = links[is_left[links[:, first]] & ~is_left[links[:, second]]]
        for patch, other in zip(
            patches[mixed[:, first]].tolist(), labels[mixed[:, second]].tolist(), strict=True
        ):
            touches.setdefault(patch, set()).add(other)
    own = [patch for patch, others in touches.items() if others == {label}]
    return np.flatnonzero((labels == label) | (is_left & np.isin(patches, own)))


def _turn(faces: np.ndarray, normals: np.ndarray, vertices: np.ndarray) -> np.ndarray:
    """Order corners so that faces look along the given normals."""
    own, _ = compute_normals(vertices, faces)
    against = (own * normals).sum(axis=1) < 0
    faces = faces.copy()
    faces[against] = faces[against][:, [0, 2, 1]]
    return faces


def _enclosed(vertices: np.ndarray, faces: np.ndarray) -> float:
    """Volume that a surface encloses once its openings are closed, negative if it faces inward."""
    corners = [vertices[faces]]
    edges = compute_edge_table(faces)
    is_open = (edges.counts == 1)[edges.face_edges]
    if is_open.any():
        start, end = faces[is_open], np.roll(faces, -1, axis=1)[is_open]
        labels = _label_rims(np.column_stack([start, end]))
        count = np.bincount(labels)
        middle = np.column_stack(
            [np.bincount(labels, vertices[start, k]) / count for k in range(3)]
        )[labels]
        corners.append(np.stack([vertices[end], vertices[start], middle], axis=1))
    every = np.concatenate(corners) - vertices[np.unique(faces)].mean(axis=0)
    return float((every[:, 0] * np.cross(every[:, 1], every[:, 2])).sum() / 6)
