"""Turn a garment into its own frame: neck or waist towards +y, front up, "left" at -x."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import permutations, product

import numpy as np

from dgl_assets.importing.directions import Directions
from dgl_assets.importing.errors import UnclearGarmentError
from dgl_assets.importing.front import turn_front_up
from dgl_assets.importing.openings import Openings
from dgl_assets.importing.topology import compute_normals, find_loops

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
_ALIGNED = 0.7  # cosine at which the up axis decides about a direction
_ON_THEIR_RIM = ("Baseball_Cap", "Bowl_Hat")
_FLAT = 0.12  # depth over length of a garment that lies flat


@dataclass(frozen=True, kw_only=True, eq=False)
class Frame:
    """Orientation of a garment in its file."""

    rotation: np.ndarray
    """Rows are the garment's x, y, z in the axes of the file, shape (3, 3), a rotation."""
    up: str
    """Up axis of the file, as given, stated or found, such as "y"."""
    notes: tuple[str, ...]
    """Assumptions that were made."""


def turn_outward(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, bool]:
    """Turn the faces of a garment over if they face inward.

    Args:
        vertices: Positions, shape (V, 3).
        faces: Consistently oriented triangles, shape (F, 3), int.

    Returns:
        Faces with normals outward, and True if they were turned. A sheet that encloses nothing
        stays as it is.
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
    directions: Directions,
) -> Frame:
    """Find the axes of a garment from its openings, and their signs from landmarks where given.

    Args:
        vertices: Positions, shape (V, 3), axes of the file.
        faces: Triangles with normals outward, shape (F, 3), int.
        category: Category of the garment.
        openings: Its openings.
        up: Up axis given by the user, a name of `AXES`.
        declared_up: Up axis that the file states.
        directions: Directions told by the names of landmarks.

    Raises:
        ValueError: If `up` is unknown.
        UnclearGarmentError: If the openings give no direction.
    """
    if up is not None and up not in AXES:
        raise ValueError(f"up must be one of {list(AXES)}; got {up!r}")
    stated = up or declared_up
    towards = None if stated is None else np.array(AXES[stated], dtype=np.float64)
    if openings.pair is not None:
        y, x, notes = _find_body_axes(vertices, openings, towards, directions)
    elif category == "Scarf":
        y, x, notes = _find_sheet_axes(vertices, directions)
    else:
        y, x, notes = _find_shell_axes(vertices, faces, category, openings)
    notes += directions.notes
    rotation = _complete(x, y)
    if openings.pair is not None and directions.axes is not None:
        rotation = _name_axes(rotation, directions.axes)
    snapped = _snap(rotation)
    if openings.pair is not None:
        if snapped is None:  # the openings alone are some degrees off: necklines lean forward
            rotation = _align_depth(rotation, vertices)
        rotation = rotation if snapped is None else snapped
        if directions.right is None:
            rotation, more = turn_front_up(rotation, vertices, openings, towards)
            notes += more
        else:
            notes.append(
                "front, left and up are as the names of the landmarks say"
                if directions.up is not None
                else "front and left are as the names of the landmarks say"
            )
    elif snapped is not None:
        rotation = snapped
    found, how = _name_up(rotation, vertices, category, stated)
    if up is None:
        how = how if declared_up is None else "as the file states"
        notes.append(f"up axis {found}, {how}")
    else:
        notes.append(f"up axis {found}, as given")
    return Frame(rotation=rotation, up=found, notes=tuple(notes))


def _complete(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Make a rotation with y [unit vector] as second row and the first row nearest to x."""
    x = x - y * (x @ y)
    size = np.linalg.norm(x)
    if size < 1e-9:
        raise UnclearGarmentError(
            "the openings lie on one line, so that left and right cannot be told apart"
        )
    return np.stack([x / size, y, np.cross(x / size, y)])


def _name_axes(rotation: np.ndarray, named: np.ndarray) -> np.ndarray:
    """Put the axes of a garment into the order and signs that its landmarks tell.

    Openings give exact axes but may be mistaken for one another. Landmarks lie anywhere on a part,
    but their names are right.
    """
    candidates = [turn @ rotation for turn in _list_turns()]
    best = max(candidates, key=lambda axes: float((axes * named).sum()))
    return best if (best * named).sum(axis=1).min() > _ALIGNED else named


def _find_body_axes(
    vertices: np.ndarray,
    openings: Openings,
    towards: np.ndarray | None,
    directions: Directions,
) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """Find +y and an x of tops, dresses, coats and trousers."""
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
    if directions.right is not None:
        x = x * np.sign(directions.right @ x)
    if directions.up is not None:
        y = y * np.sign(directions.up @ y)
        if directions.right is None:
            notes.append("neck and hem, or waist and legs, are as the names of the landmarks say")
    elif towards is not None and abs(towards @ y) > _ALIGNED and towards @ y < 0:
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


def _find_sheet_axes(
    vertices: np.ndarray, directions: Directions
) -> tuple[np.ndarray, np.ndarray, list[str]]:
    axes = np.linalg.svd(vertices - vertices.mean(axis=0), full_matrices=False)[2]
    notes = ["long side along x"]
    if directions.right is not None and directions.right @ axes[0] < 0:
        return -axes[1], -axes[0], [*notes, "left is as the names of the landmarks say"]
    return axes[1], axes[0], notes


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


def _align_depth(rotation: np.ndarray, vertices: np.ndarray) -> np.ndarray:
    """Turn about x, so that the garment is thinnest along z."""
    side = (vertices - vertices.mean(axis=0)) @ rotation[1:].T
    along = np.linalg.svd(side, full_matrices=False)[2][0]
    along = along * np.sign(along[0])
    if along[0] < _SNAP:  # as deep as long: the openings know better
        return rotation
    y, z = rotation[1:]
    return np.stack([rotation[0], along[0] * y + along[1] * z, along[0] * z - along[1] * y])


def _list_turns() -> list[np.ndarray]:
    """List the 24 rotations that take axes to axes."""
    turns = []
    for order in permutations(range(3)):
        for signs in product((1.0, -1.0), repeat=3):
            candidate = np.zeros((3, 3))
            candidate[range(3), order] = signs
            if np.linalg.det(candidate) > 0:
                turns.append(candidate)
    return turns


def _snap(rotation: np.ndarray) -> np.ndarray | None:
    """Find the rotation along the axes of the file that is near, if there is one."""
    for candidate in _list_turns():
        if (candidate * rotation).sum(axis=1).min() > _SNAP:
            return candidate
    return None


def _name_up(
    rotation: np.ndarray, vertices: np.ndarray, category: str, stated: str | None
) -> tuple[str, str]:
    """Name the up axis of the file, and the way in which it was found."""
    if stated is not None:
        return stated, ""
    if category in _ON_THEIR_RIM:
        return _name_axis(rotation[2]), "found from the rim"
    extents = np.ptp(vertices @ rotation.T, axis=0)
    lies = extents[2] < _FLAT * extents[:2].max()
    direction = rotation[2] if lies else rotation[1]
    text = "found from the thin side of a garment that lies" if lies else "found from the openings"
    return _name_axis(direction), text


def _name_axis(direction: np.ndarray) -> str:
    return max(AXES, key=lambda axis: float(np.dot(AXES[axis], direction)))
