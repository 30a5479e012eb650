"""Turn a garment into its own frame: neck or waist towards +y, front up, "left" at -x."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import permutations, product

import numpy as np

from dgl_assets.importing.errors import UnclearGarmentError
from dgl_assets.importing.openings import Openings
from dgl_assets.importing.topology import compute_normals, compute_vertex_normals, find_loops

AXES: dict[str, tuple[float, float, float]] = {
    "x": (1, 0, 0),
    "y": (0, 1, 0),
    "z": (0, 0, 1),
    "-x": (-1, 0, 0),
    "-y": (0, -1, 0),
    "-z": (0, 0, -1),
}
"""Axes of a file by name."""
_SNAP = np.cos(np.radians(15))  # directions this near an axis of the file are that axis
_FRONT_CLEAR = 0.015  # of the length that the neckline must be deeper in front
_ALIGNED = 0.7  # cosine at which the up axis decides about a direction
_FLAT = 0.12  # depth over length of a garment that lies flat


@dataclass(frozen=True, kw_only=True, eq=False)
class Frame:
    """How a garment stands in its file."""

    rotation: np.ndarray
    """Rows are the garment's x, y, z in the axes of the file, shape (3, 3), a rotation."""
    up: str
    """Up axis of the file, as given, stated or found, such as "y"."""
    notes: tuple[str, ...]
    """What was assumed."""


def turn_outward(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, bool]:
    """Turn the faces of a garment over if they face inward.

    Args:
        vertices: Positions, shape (V, 3).
        faces: Consistently oriented triangles, shape (F, 3), int.

    Returns:
        Faces with normals outward, and whether they were turned. A sheet that encloses nothing stays as it is.
    """
    triangles = [vertices[faces]]
    for loop in find_loops(faces):  # close the openings
        around = vertices[loop]
        centre = np.tile(around.mean(axis=0), (len(loop), 1))
        triangles.append(np.stack([np.roll(around, -1, axis=0), around, centre], axis=1))
    corners = np.concatenate(triangles) - vertices.mean(axis=0)
    volume = (corners[:, 0] * np.cross(corners[:, 1], corners[:, 2])).sum() / 6
    is_inward = volume < 0
    return (faces[:, [0, 2, 1]] if is_inward else faces), bool(is_inward)


def find_frame(
    vertices: np.ndarray,
    faces: np.ndarray,
    *,
    category: str,
    openings: Openings,
    up: str | None,
    declared_up: str | None,
) -> Frame:
    """Find the directions of a garment from its openings.

    Args:
        vertices: Positions, shape (V, 3), axes of the file.
        faces: Triangles with normals outward, shape (F, 3), int.
        category: What it is.
        openings: Its openings.
        up: Up axis if the user says it, a name of `AXES`.
        declared_up: Up axis that the file states.

    Raises:
        ValueError: If `up` is unknown.
        UnclearGarmentError: If the openings give no direction.
    """
    if up is not None and up not in AXES:
        raise ValueError(f"up must be one of {list(AXES)}; got {up!r}")
    stated = up or declared_up
    towards = None if stated is None else np.array(AXES[stated], dtype=np.float64)
    if openings.pair is not None:
        y, x, notes = _find_body_axes(vertices, openings, towards)
    elif category == "Scarf":
        y, x, notes = _find_sheet_axes(vertices)
    else:
        y, x, notes = _find_shell_axes(vertices, faces, category, openings)
    x = x - y * (x @ y)
    size = np.linalg.norm(x)
    if size < 1e-9:
        raise UnclearGarmentError(
            "the openings lie on one line, so that left and right cannot be told apart"
        )
    x /= size
    rotation = np.stack([x, y, np.cross(x, y)])
    snapped = _snap(rotation)
    if openings.pair is not None:
        if snapped is None:  # the openings alone are some degrees off: necklines lean forward
            rotation = _align_depth(rotation, vertices)
        rotation, more = _turn_front_up(
            rotation if snapped is None else snapped, vertices, faces, openings, towards
        )
        notes += more
    elif snapped is not None:
        rotation = snapped
    found, how = _name_up(rotation, vertices, stated)
    if up is None:
        how = how if declared_up is None else "as the file states"
        notes.append(f"up axis {found}, {how}")
    else:
        notes.append(f"up axis {found}, as given")
    return Frame(rotation=rotation, up=found, notes=tuple(notes))


def _find_body_axes(
    vertices: np.ndarray, openings: Openings, towards: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """+y and an x of tops, dresses, coats and trousers."""
    assert openings.pair is not None
    left, right = (vertices[loop].mean(axis=0) for loop in openings.pair)
    x = right - left
    main = vertices[openings.main]
    if openings.neck is not None:
        y = vertices[openings.neck].mean(axis=0) - main.mean(axis=0)
        y -= x * (x @ y) / (x @ x)
    else:
        # Trousers and coats: along the body, seen in the plane between left and right.
        across = x / np.linalg.norm(x)
        y = main.mean(axis=0) - (left + right) / 2
        y -= across * (across @ y)
        rest = vertices - np.outer(vertices @ across, across)
        extents = np.linalg.svd(rest - rest.mean(axis=0), full_matrices=False)
        along = extents[2][0]
        if abs(along @ y) < 0.35 * np.ptp(rest @ along):  # the main opening runs along a coat
            y = along * _find_neck_end(main, along, across)
        else:
            y = along * np.sign(along @ y)
    y = y / np.linalg.norm(y)
    notes = []
    if towards is not None and abs(towards @ y) > _ALIGNED and towards @ y < 0:
        y = -y
        notes.append("turned upside down, after the up axis")
    return y, x, notes


def _find_neck_end(main: np.ndarray, along: np.ndarray, across: np.ndarray) -> float:
    """Sign of the narrow end of a coat's front opening: the hem is wider than the neck."""
    share = main @ along
    low, high = share.min(), share.max()
    ends = [
        np.ptp((main @ across)[mask])
        for mask in (share > high - 0.15 * (high - low), share < low + 0.15 * (high - low))
    ]
    return 1.0 if ends[0] < ends[1] else -1.0


def _find_sheet_axes(vertices: np.ndarray) -> tuple[np.ndarray, np.ndarray, list[str]]:
    axes = np.linalg.svd(vertices - vertices.mean(axis=0), full_matrices=False)[2]
    return axes[1], axes[0], ["long side along x"]


def _find_shell_axes(
    vertices: np.ndarray, faces: np.ndarray, category: str, openings: Openings
) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """Hats stand on their rim, the brim of a cap towards -y; gloves lie, fingers towards +y."""
    _, areas = compute_normals(vertices, faces)
    middle = (vertices[faces].mean(axis=1) * areas[:, None]).sum(axis=0) / areas.sum()
    away = middle - vertices[openings.main].mean(axis=0)
    away /= np.linalg.norm(away)
    spread = vertices - middle
    spread = spread - np.outer(spread @ away, away)
    if category == "Glove":
        thin = np.linalg.svd(spread, full_matrices=False)[2][1]
        return (
            away,
            np.cross(away, thin),
            ["fingers towards +y; which side is the palm is not known"],
        )
    farthest = spread[np.argmax(np.linalg.norm(spread, axis=1))]
    y = -farthest / np.linalg.norm(farthest)
    return y, np.cross(y, away), ["rim down, the farthest point of the brim towards -y"]


def _turn_front_up(
    rotation: np.ndarray,
    vertices: np.ndarray,
    faces: np.ndarray,
    openings: Openings,
    towards: np.ndarray | None,
) -> tuple[np.ndarray, list[str]]:
    """Make +z the front: where the neckline, or the waist, is lower, or a coat opens."""
    turned = rotation * np.array([[-1.0], [1.0], [-1.0]])
    normals = compute_vertex_normals(vertices, faces) @ rotation[2]
    along = vertices @ rotation[1]
    length = np.ptp(along)
    loop = openings.main if openings.neck is None else openings.neck
    if openings.neck is None and np.ptp(along[loop]) > 0.5 * length:
        low, high = along[loop].min(), along[loop].max()
        inside = loop[np.abs(along[loop] - (low + high) / 2) < 0.3 * (high - low)]
        if not len(inside):
            raise UnclearGarmentError("where the front opens cannot be told; give the category")
        facing = float(normals[inside].mean())
        return (rotation if facing > 0 else turned), ["front where it opens"]
    front, back = loop[normals[loop] > 0.3], loop[normals[loop] < -0.3]
    if len(front) and len(back):
        deeper = along[back].min() - along[front].min()
        if abs(deeper) > _FRONT_CLEAR * length:
            return (rotation if deeper > 0 else turned), [
                "front where the neckline or waist is lower"
            ]
    if towards is not None and abs(rotation[2] @ towards) > _ALIGNED:
        return (rotation if rotation[2] @ towards > 0 else turned), [
            "front and back look alike; assumed that it lies on its back"
        ]
    # Standing bodies look along +z where y is up, along -y where z is up.
    ahead = np.array([0.0, 0, 1]) if abs(rotation[1][1]) > 0.5 else np.array([0.0, -1, 0])
    side = rotation[2] @ ahead
    return (rotation if side >= 0 else turned), [
        "front and back look alike; the front is assumed as is usual for the axes of the file"
    ]


def _align_depth(rotation: np.ndarray, vertices: np.ndarray) -> np.ndarray:
    """Turn about x, so that the garment is thinnest along z."""
    side = (vertices - vertices.mean(axis=0)) @ rotation[1:].T
    along = np.linalg.svd(side, full_matrices=False)[2][0]
    along = along * np.sign(along[0])
    if along[0] < _SNAP:  # as deep as long: the openings know better
        return rotation
    y, z = rotation[1:]
    return np.stack([rotation[0], along[0] * y + along[1] * z, along[0] * z - along[1] * y])


def _snap(rotation: np.ndarray) -> np.ndarray | None:
    """The rotation along the axes of the file that is near, if one is."""
    for order in permutations(range(3)):
        for signs in product((1.0, -1.0), repeat=3):
            candidate = np.zeros((3, 3))
            candidate[range(3), order] = signs
            cosines = (candidate * rotation).sum(axis=1)
            if np.linalg.det(candidate) > 0 and cosines.min() > _SNAP:
                return candidate
    return None


def _name_up(rotation: np.ndarray, vertices: np.ndarray, stated: str | None) -> tuple[str, str]:
    if stated is not None:
        return stated, ""
    extents = np.ptp(vertices @ rotation.T, axis=0)
    lies = extents[2] < _FLAT * extents[:2].max()
    direction = rotation[2] if lies else rotation[1]
    name = max(AXES, key=lambda axis: float(np.dot(AXES[axis], direction)))
    text = (
        "found from the thin side of a garment that lies"
        if lies
        else "found from the neck or waist"
    )
    return name, text
