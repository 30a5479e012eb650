"""Check that a mesh is one sheet of cloth: repair safe faults, refuse others with their place."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dgl_assets.importing.errors import BrokenMeshError, UnclearGarmentError
from dgl_assets.importing.layers import (
    LARGEST_ATTACHED,
    drop_attached,
    is_inner_side,
    lies_on,
    measure_gap,
    take_outer_surface,
)
from dgl_assets.importing.objects import choose_object, list_objects, split_choice
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
_LAYERS = 50  # pieces that are compared with the garment
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
    """Repairs that were made."""


def clean_mesh(
    raw: RawMesh, name: str, *, choice: str | None = None, weld: float | None = None
) -> CleanMesh:
    """Weld and check a mesh.

    Args:
        raw: Content of the file.
        name: Name of the file, for messages.
        choice: Object or connected part to take; see `split_choice`.
        weld: Distance below which open edges are sewn together, in the units of the file; found
            from the size when None.

    Returns:
        The mesh: one piece, at most two faces at each edge, one fan of faces at each vertex, one
        orientation.

    Raises:
        BrokenMeshError: If that would need guessing. Numbers in messages are those of the file,
            from 0.
    """
    wanted, part = split_choice(choice, raw)
    raw = choose_object(raw, wanted, name)
    vertices, notes = raw.vertices, list(raw.notes)
    stands_for, tolerance = weld_vertices(vertices, raw.faces, tolerance=weld)
    joined = int((stands_for != np.arange(len(vertices))).sum())
    if joined:
        notes.append(f"{joined} vertices within {tolerance:.3g} units of others were welded")
    faces = stands_for[raw.faces]
    keep, more = _find_sound_faces(vertices, faces, name)
    notes += more
    pieces, more = _choose_piece(raw, faces, keep, name, part)
    notes += more
    keep = keep[pieces]
    sheet, more = drop_attached(vertices, faces[keep], name)
    notes += more
    keep = keep[sheet]
    faces, turned = _orient(faces[keep], name)
    outer, more = take_outer_surface(vertices, faces)
    notes += more
    faces, keep, turned = faces[outer], keep[outer], turned[outer]
    if turned.any():
        notes.append(f"{int(turned.sum())} faces were turned over to agree with their neighbours")
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
            f"{name}: {len(slivers)} of {len(keep)} faces have no area, the first is face "
            f"{keep[slivers[0]]} "
            f"with vertices {faces[keep[slivers[0]]].tolist()}"
        )
    return keep, notes


def _drop_doubles(faces: np.ndarray, keep: np.ndarray) -> tuple[np.ndarray, list[str]]:
    """Keep one of equal faces, or none where it would be a third face at an edge."""
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


def _orient(faces: np.ndarray, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Turn as few faces as possible so that neighbours agree; return the faces and a mask."""
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
            f"{name}: {len(twisted)} faces lie on a one-sided surface (a twisted band), the first "
            "is face "
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
    raw: RawMesh, faces: np.ndarray, keep: np.ndarray, name: str, part: int | None
) -> tuple[np.ndarray, list[str]]:
    """Choose the piece that is the garment; scraps such as buttons are left out.

    Args:
        raw: Content of the file.
        faces: Welded triangles of the file, shape (F, 3).
        keep: Those that are sound, shape (N,).
        name: Name of the file.
        part: Number of the piece by its area, from 1; found when None.

    Returns:
        Its sound triangles, and notes about parts that were left out.
    """
    count, labels = label_pieces(faces[keep])
    if count == 1 and part in (None, 1):
        return np.arange(len(keep)), []
    _, areas = compute_normals(raw.vertices, faces[keep])
    shares = np.bincount(labels, areas) / max(areas.sum(), 1e-300)
    order = np.argsort(-shares, kind="stable")
    if part is not None:
        if part > count:
            raise UnclearGarmentError(
                f"{name} has {count} connected parts; there is no `object` part{part}"
            )
        return np.flatnonzero(labels == order[part - 1]), [
            f"part{part} of {count} connected parts was taken, {shares[order[part - 1]]:.1%} of "
            "the area"
        ]
    rest = order[1:]
    notes = []
    if shares[rest[0]] > _LARGEST_SCRAP or shares[rest].sum() > _LARGEST_SCRAPS:
        rest, more = _leave_out_layers(raw, faces[keep], labels, order)
        notes += more
    scraps = shares[rest]
    if len(rest) and (scraps[0] > _LARGEST_SCRAP or scraps.sum() > _LARGEST_SCRAPS):
        raise BrokenMeshError(_describe_pieces(raw, faces, keep, labels, order, shares, name))
    if len(rest):
        notes.append(
            f"{len(rest)} loose pieces of {scraps.sum():.2%} of the area (buttons, labels) were "
            "dropped"
        )
    return np.flatnonzero(labels == order[0]), notes


def _leave_out_layers(
    raw: RawMesh, faces: np.ndarray, labels: np.ndarray, order: np.ndarray
) -> tuple[np.ndarray, list[str]]:
    """Leave out pieces that lie on the largest: pockets, and the inner side of a thickness.

    Returns:
        The other pieces but the largest, in their order, and notes about those left out.
    """
    main = faces[labels == order[0]]
    areas = compute_normals(raw.vertices, faces)[1]
    shares = np.bincount(labels, areas) / max(areas.sum(), 1e-300)
    if is_inner_side(raw.vertices, main, faces[labels == order[1]]):
        return order[2:], [
            "a second piece runs along the inside of the first, its inner side or a lining; it was "
            "dropped"
        ]
    left, on_it, area = [], [], 0.0
    for label in order[1 : 1 + _LAYERS].tolist():
        is_small = area + shares[label] < LARGEST_ATTACHED
        if is_small and lies_on(raw.vertices, main, faces[labels == label]):
            on_it.append(label)
            area += shares[label]
        else:
            left.append(label)
    if not on_it:
        return order[1:], []
    return np.array([*left, *order[1 + _LAYERS :]], dtype=order.dtype), [
        f"{len(on_it)} loose pieces that lie on the cloth (pockets, {area:.1%} of the area) were "
        "dropped"
    ]


def _describe_pieces(
    raw: RawMesh,
    faces: np.ndarray,
    keep: np.ndarray,
    labels: np.ndarray,
    order: np.ndarray,
    shares: np.ndarray,
    name: str,
) -> str:
    """List the pieces, and the options that choose one or join all."""
    shown = [f"part{k + 1} ({shares[p]:.1%} of the area)" for k, p in enumerate(order[:4])]
    listed = ", ".join(shown) + (", ..." if len(order) > 4 else "")
    named = list_objects(raw, keep)
    if named:
        listed = f"{named}; or {listed}"
    text = (
        f"{name}: the surface is in {len(order)} loose pieces; choose one with `object`: " + listed
    )
    gap = measure_gap(raw.vertices, *(faces[keep][labels == order[k]] for k in (0, 1)))
    if gap is not None:
        text += (
            f". Seams that lie apart are joined by `weld`; the first two are {gap:.2g} units apart"
        )
    return text


def _split_fans(faces: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Give each fan of faces around a vertex a vertex of its own.

    Returns:
        The faces, and the former vertex of each vertex, shape (W,): all former ones, then copies.
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
