"""Make sure that a mesh is one sheet of cloth: repair what is safe, and refuse the rest with place and count."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dgl_assets.importing.errors import BrokenMeshError
from dgl_assets.importing.raw import RawMesh
from dgl_assets.importing.topology import (
    compute_edge_table,
    compute_normals,
    drop_unused,
    label_components,
    label_pieces,
)
from dgl_assets.importing.weld import weld_vertices

_LARGEST_SCRAP = 0.01  # of the area: buttons and labels are dropped
_LARGEST_SCRAPS = 0.03  # of the area, all together
_MAX_SLIVERS = 0.01  # of the faces
_SLIVER = 1e-4  # height over longest side; remeshing removes them


@dataclass(frozen=True, kw_only=True, eq=False)
class CleanMesh:
    """One oriented manifold piece, still in the units of its file."""

    vertices: np.ndarray
    """Positions, shape (V, 3), float64."""
    faces: np.ndarray
    """Triangles, shape (F, 3), int64; neighbours agree about the outside."""
    uvs: np.ndarray | None
    """Texture coordinates of each corner, shape (F, 3, 2)."""
    vertex_ids: np.ndarray
    """Vertex of each vertex of the file, -1 for those that are gone, shape (W,)."""
    notes: tuple[str, ...]
    """What was repaired."""


def clean_mesh(raw: RawMesh, name: str) -> CleanMesh:
    """Weld and check a mesh.

    Args:
        raw: What was read.
        name: Of the file, for messages.

    Returns:
        The mesh: one piece, two faces at most at each edge, one fan of faces at each vertex, one orientation.

    Raises:
        BrokenMeshError: If that would need guessing. Numbers in messages are those of the file, from 0.
    """
    vertices, notes = raw.vertices, []
    stands_for, tolerance = weld_vertices(vertices, raw.faces)
    joined = int((stands_for != np.arange(len(vertices))).sum())
    if joined:
        notes.append(f"{joined} vertices within {tolerance:.3g} units of others were welded")
    faces = stands_for[raw.faces]
    keep, more = _find_sound_faces(vertices, faces, name)
    notes += more
    faces = faces[keep]
    _check_edges(vertices, faces, name)
    faces, turned = _orient(faces, name)
    if turned is not None and turned.any():
        notes.append(f"{int(turned.sum())} faces were turned over to agree with their neighbours")
    pieces, more = _choose_piece(vertices, faces, name)
    notes += more
    faces, keep, turned = faces[pieces], keep[pieces], turned[pieces]
    uvs = None
    if raw.uvs is not None:
        uvs = raw.uvs[keep]
        uvs[turned] = uvs[turned][:, [0, 2, 1]]
    faces, origin = _split_fans(faces, len(vertices))
    if len(origin) > len(vertices):
        notes.append(
            f"{len(origin) - len(vertices)} points where surfaces only touch were separated"
        )
    used, faces = drop_unused(origin[:, None], faces)
    number = np.full(len(vertices), -1, dtype=np.int64)
    number[origin[used][::-1]] = np.arange(len(used))[::-1]
    return CleanMesh(
        vertices=vertices[origin[used]],
        faces=faces,
        uvs=uvs,
        vertex_ids=number[stands_for],
        notes=tuple(notes),
    )


def _find_sound_faces(
    vertices: np.ndarray, faces: np.ndarray, name: str
) -> tuple[np.ndarray, list[str]]:
    """Faces with three corners, each once."""
    notes = []
    repeated = (faces == np.roll(faces, 1, axis=1)).any(axis=1)
    keep = np.flatnonzero(~repeated)
    if not len(keep):
        raise BrokenMeshError(
            f"{name}: all {len(faces)} faces are degenerate (two corners are one)"
        )
    if repeated.any():
        notes.append(f"{int(repeated.sum())} faces with two corners in one were dropped")
    keep, more = _drop_doubles(faces, keep)
    notes += more
    corners = vertices[faces[keep]]
    _, areas = compute_normals(vertices, faces[keep])
    longest = ((corners - np.roll(corners, 1, axis=1)) ** 2).sum(axis=2).max(axis=1)
    slivers = np.flatnonzero(2 * areas <= _SLIVER * longest)
    if len(slivers) > _MAX_SLIVERS * len(keep):
        raise BrokenMeshError(
            f"{name}: {len(slivers)} of {len(keep)} faces have no area, the first is face {keep[slivers[0]]} "
            f"with vertices {faces[keep[slivers[0]]].tolist()}"
        )
    return keep, notes


def _drop_doubles(faces: np.ndarray, keep: np.ndarray) -> tuple[np.ndarray, list[str]]:
    """Keep one of faces with the same corners, or none where it would be a third face at an edge."""
    _, first, group, counts = np.unique(
        np.sort(faces[keep], axis=1),
        axis=0,
        return_index=True,
        return_inverse=True,
        return_counts=True,
    )
    if len(first) == len(keep):
        return keep, []
    notes = [f"{len(keep) - len(first)} faces that were there twice were dropped"]
    kept = np.sort(first)
    was_double = (counts > 1)[group.reshape(-1)][kept]
    keep = keep[kept]
    edges = compute_edge_table(faces[keep])
    in_the_way = was_double & (edges.counts > 2)[edges.face_edges].any(axis=1)
    if in_the_way.any():  # corners where front and back are the same triangle
        notes.append(f"{int(in_the_way.sum())} corners where both layers are one face were dropped")
    return keep[~in_the_way], notes


def _check_edges(vertices: np.ndarray, faces: np.ndarray, name: str) -> None:
    edges = compute_edge_table(faces)
    crowded = np.flatnonzero(edges.counts > 2)
    if len(crowded):
        a, b = edges.pairs[crowded[0]]
        place = ", ".join(f"{x:.4g}" for x in vertices[[a, b]].mean(axis=0))
        raise BrokenMeshError(
            f"{name}: {len(crowded)} edges have more than two faces, the first joins vertices {a} and {b} near "
            f"({place}) and has {edges.counts[crowded[0]]}; layers, folds or thickness must be separate surfaces"
        )


def _orient(faces: np.ndarray, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Turn faces so that neighbours agree, as few as possible; return the faces and which were turned."""
    edges = compute_edge_table(faces)
    inner = np.flatnonzero(edges.counts == 2)
    first, second = edges.faces[inner].T
    is_forward = faces < np.roll(
        faces, -1, axis=1
    )  # whether a face runs along the edge's direction
    side = [
        is_forward[f, np.argmax(edges.face_edges[f] == inner[:, None], axis=1)]
        for f in (first, second)
    ]
    disagree = side[0] == side[1]
    count = len(faces)
    # Each face is there twice, as it is and turned over; links join those that agree.
    links = np.concatenate(
        [
            np.column_stack([first, second + count * disagree]),
            np.column_stack([first + count, second + count * ~disagree]),
        ]
    )
    _, labels = label_components(2 * count, links)
    twisted = np.flatnonzero(labels[:count] == labels[count:])
    if len(twisted):
        raise BrokenMeshError(
            f"{name}: {len(twisted)} faces lie on a one-sided surface (a twisted band), the first is face "
            f"{twisted[0]}; cloth needs an inside and an outside"
        )
    _, pieces = label_components(count, edges.faces[inner])
    turned = np.zeros(count, dtype=bool)
    for piece in range(pieces.max() + 1):
        members = np.flatnonzero(pieces == piece)
        chosen = labels[members] == labels[members[0]]
        turned[members] = ~chosen if chosen.mean() > 0.5 else chosen
    faces = faces.copy()
    faces[turned] = faces[turned][:, [0, 2, 1]]
    return faces, turned


def _choose_piece(
    vertices: np.ndarray, faces: np.ndarray, name: str
) -> tuple[np.ndarray, list[str]]:
    """Faces of the garment itself; scraps such as buttons are left out."""
    count, labels = label_pieces(faces)
    if count == 1:
        return np.arange(len(faces)), []
    _, areas = compute_normals(vertices, faces)
    shares = np.bincount(labels, areas) / areas.sum()
    order = np.argsort(-shares, kind="stable")
    scraps = shares[order[1:]]
    if scraps[0] > _LARGEST_SCRAP or scraps.sum() > _LARGEST_SCRAPS:
        large = ", ".join(f"{share:.1%}" for share in shares[order[:4]])
        face = int(np.flatnonzero(labels == order[1])[0])
        raise BrokenMeshError(
            f"{name}: the surface is in {count} loose pieces ({large}{', ...' if count > 4 else ''} of the area), the "
            f"second holds face {face}; sew them together or export them one by one"
        )
    return np.flatnonzero(labels == order[0]), [
        f"{count - 1} loose pieces of {scraps.sum():.2%} of the area (buttons, labels) were dropped"
    ]


def _split_fans(faces: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Give each fan of faces around a vertex a vertex of its own.

    Returns:
        The faces, and for each vertex the former one, shape (W,): first all former ones, then copies.
    """
    edges = compute_edge_table(faces)
    inner = np.flatnonzero(edges.counts == 2)
    first, second = edges.faces[inner].T
    links = []
    for end in range(2):  # corners of two faces at the same end of their common edge
        vertex = edges.pairs[inner, end][:, None]
        corner = [f * 3 + np.argmax(faces[f] == vertex, axis=1) for f in (first, second)]
        links.append(np.column_stack(corner))
    _, fans = label_components(3 * len(faces), np.concatenate(links))
    corners = faces.ravel()
    fan_vertex = np.empty(fans.max() + 1, dtype=np.int64)
    fan_vertex[fans] = corners
    order = np.argsort(fan_vertex, kind="stable")
    is_first = np.ones(len(order), dtype=bool)
    is_first[1:] = fan_vertex[order][1:] != fan_vertex[order][:-1]
    number = np.empty(len(order), dtype=np.int64)
    number[order[is_first]] = fan_vertex[order[is_first]]
    extra = order[~is_first]
    number[extra] = count + np.arange(len(extra))
    return number[fans].reshape(-1, 3), np.concatenate([np.arange(count), fan_vertex[extra]])
