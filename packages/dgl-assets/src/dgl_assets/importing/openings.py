"""Tell the openings of a garment apart, and which garment has such openings."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from dgl_assets.importing.categories import CATEGORIES
from dgl_assets.importing.errors import UnclearGarmentError
from dgl_assets.importing.holes import compute_perimeter
from dgl_assets.importing.topology import compute_normals, find_loops

_OF_THE_LONGEST, _OF_THE_EXTENT = 0.10, 0.055
_SLEEVES = 1.15  # distance of the cuffs over the width of the body
_DRESS = 1.74  # length over the width of the body
_BODY = (0.5, 0.6)  # levels from hem to neck at which the body is measured, of the length
_BAND, _GAP = (
    0.04,
    0.1,
)  # half height of such a level, and the gap that parts a sleeve from the body, of the length
_TROUSERS = 0.5  # distance from the legs to the waist, over the longest extent
_SCARF = 2.5  # length over width
_HOLLOW = 1.1  # surface of a hat or glove over its opening's area; a wide brim gives 1.3
_CLOSED = (
    "a closed surface is sewn shut, or has a thickness whose sides cannot be told: open it, or "
    "export its outside alone"
)


@dataclass(frozen=True, kw_only=True, eq=False)
class Openings:
    """The openings of a garment, by the part that they play."""

    main: np.ndarray
    """Vertices of the hem of a top, the waist of trousers, the rim of a hat, shape (L,)."""
    neck: np.ndarray | None
    """Of garments with a neckline of its own."""
    pair: tuple[np.ndarray, np.ndarray] | None
    """Cuffs, armholes or legs."""


def find_openings(vertices: np.ndarray, faces: np.ndarray) -> list[np.ndarray]:
    """Find the openings that are large enough to be a garment's, longest first.

    Args:
        vertices: Positions, shape (V, 3).
        faces: Oriented manifold triangles, shape (F, 3), int.
    """
    loops = find_loops(faces)
    if not loops:
        return []
    lengths = np.array([compute_perimeter(vertices, loop) for loop in loops])
    order = np.argsort(-lengths, kind="stable")
    smallest = compute_smallest_opening(vertices, loops[order[0]])
    return [loops[k] for k in order if lengths[k] >= smallest]


def compute_smallest_opening(vertices: np.ndarray, longest: np.ndarray) -> float:
    """Compute the perimeter below which an opening is a slit or a buttonhole.

    A tenth of the longest opening, in the units of the vertices. Where that is a wide hem or the
    whole front of a coat, cuffs are less, and the extent of the garment counts.

    Args:
        vertices: Positions, shape (V, 3).
        longest: Vertices of the longest opening, shape (L,).
    """
    extent = float(np.linalg.norm(np.ptp(vertices, axis=0)))
    return min(_OF_THE_LONGEST * compute_perimeter(vertices, longest), _OF_THE_EXTENT * extent)


def name_openings(vertices: np.ndarray, loops: list[np.ndarray], category: str) -> Openings:
    """Tell which opening is which.

    Args:
        vertices: Positions, shape (V, 3).
        loops: Openings, longest first.
        category: What it is.

    Raises:
        UnclearGarmentError: If there are not as many openings as the category has.
    """
    expected = CATEGORIES[category].openings
    if len(loops) != len(expected):
        raise UnclearGarmentError(
            f"a {category} has {len(expected)} openings ({', '.join(expected)}), this has "
            f"{len(loops)}" + ("" if loops else f"; {_CLOSED}")
        )
    if len(loops) == 1:
        return Openings(main=loops[0], neck=None, pair=None)
    if len(loops) == 3:
        left, right, main = _choose_pair(vertices, loops, [])
        return Openings(main=main, neck=None, pair=(left, right))
    left, right, neck = _choose_pair(vertices, loops[1:], [loops[0]])
    return Openings(main=loops[0], neck=neck, pair=(left, right))


def check_hollow(
    vertices: np.ndarray, faces: np.ndarray, openings: Openings, category: str
) -> None:
    """Check that a hat or a glove has room for a head or a hand.

    Args:
        vertices: Positions, shape (V, 3).
        faces: Oriented manifold triangles, shape (F, 3), int.
        openings: Its openings.
        category: What it is; garments without a thickness of their own may be flat.

    Raises:
        UnclearGarmentError: If it is a sheet.
    """
    if CATEGORIES[category].wall_thickness is None:
        return
    rim = vertices[openings.main]
    within = 0.5 * float(np.linalg.norm(np.cross(rim, np.roll(rim, -1, axis=0)).sum(axis=0)))
    area = float(compute_normals(vertices, faces)[1].sum())
    if area < _HOLLOW * within:
        raise UnclearGarmentError(
            f"a {category} is hollow; this is a flat sheet, {area / within:.2f} times as large as "
            "its opening"
        )


def guess_category(vertices: np.ndarray, loops: list[np.ndarray]) -> tuple[str, str]:
    """Guess what a garment is from its openings and proportions.

    Args:
        vertices: Positions, shape (V, 3).
        loops: Openings, longest first.

    Returns:
        Category, and why.

    Raises:
        UnclearGarmentError: If nothing fits.
    """
    if not loops:
        raise UnclearGarmentError(f"it has no openings; {_CLOSED}")
    extents = _principal_extents(vertices)
    if len(loops) == 4:
        found = name_openings(vertices, loops, "Tops_LongSleeve")
        assert found.pair is not None
        assert found.neck is not None
        across = _distance(vertices, *found.pair)
        length = _distance(vertices, found.main, found.neck)
        width = _measure_body(vertices, found, length)
        apart, slim = across / width, length / width
        if apart < _SLEEVES:
            return "Tops_NoSleeve", (
                f"guessed: four openings, armholes {apart:.2f} widths of the body apart"
            )
        category = "Dress_LongSleeve" if slim > _DRESS else "Tops_LongSleeve"
        return category, (
            f"guessed: four openings, cuffs {apart:.2f} widths of the body apart, {slim:.2f} times "
            "as long as wide"
        )
    if len(loops) == 3:
        found = name_openings(vertices, loops, "Trousers")
        assert found.pair is not None
        middle = np.concatenate([vertices[loop] for loop in found.pair])
        reach = np.linalg.norm(vertices[found.main].mean(axis=0) - middle.mean(axis=0))
        share = reach / extents[0]
        category = "Trousers" if share > _TROUSERS else "Tops_FrontOpen"
        return category, f"guessed: three openings, {share:.2f} of the extent apart"
    if len(loops) == 1 and extents[0] > _SCARF * extents[1] and extents[2] < 0.1 * extents[1]:
        return (
            "Scarf",
            f"guessed: one flat sheet {extents[0] / extents[1]:.1f} times as long as wide",
        )
    raise UnclearGarmentError(
        f"what this is cannot be told from {len(loops)} openings; give `category`, one of "
        f"{', '.join(sorted(CATEGORIES))}"
    )


def measure_trunk(vertices: np.ndarray, openings: Openings) -> float | None:
    """Measure the geometric mean of length and width without sleeves, in units of the file.

    Args:
        vertices: Positions, shape (V, 3).
        openings: Which is which.

    Returns:
        The size; None where there are no neck and sleeves to tell.
    """
    if openings.neck is None or openings.pair is None:
        return None
    length = _distance(vertices, openings.main, openings.neck)
    return float(np.sqrt(length * _measure_body(vertices, openings, length)))


def _choose_pair(
    vertices: np.ndarray, loops: list[np.ndarray], others: list[np.ndarray]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Two loops that mirror each other, and the third."""
    best, result = np.inf, None
    for i, j in combinations(range(3), 2):
        third = loops[3 - i - j]
        cost = abs(
            np.log(compute_perimeter(vertices, loops[i]) / compute_perimeter(vertices, loops[j]))
        )
        for other in (third, *others):
            near, far = _distance(vertices, loops[i], other), _distance(vertices, loops[j], other)
            cost += abs(near - far) / max(near, far, 1e-300)
        if cost < best:
            best, result = cost, (loops[i], loops[j], third)
    assert result is not None
    return result


def _measure_body(vertices: np.ndarray, found: Openings, length: float) -> float:
    """Width of the body, the least at the levels `_BODY`, without sleeves that hang beside it."""
    assert found.pair is not None
    assert found.neck is not None
    hem = _centre(vertices, found.main)
    x = _direction(vertices, *found.pair)
    y = _centre(vertices, found.neck) - hem
    y -= x * (x @ y)
    y /= np.linalg.norm(y)
    along, across = (vertices - hem) @ y, (vertices - hem) @ x
    widths = []
    for level in _BODY:
        there = np.sort(across[np.abs(along - level * length) < _BAND * length])
        part = np.cumsum(np.diff(there, prepend=there[:1]) > _GAP * length)
        middle = there[part == part[np.argmin(np.abs(there))]] if len(there) else there
        if len(middle) < 2:  # too few vertices there; the hem is as wide
            middle = vertices[found.main] @ x
        widths.append(float(np.ptp(middle)))
    return min(widths)


def _centre(vertices: np.ndarray, loop: np.ndarray) -> np.ndarray:
    around = vertices[loop]
    lengths = np.linalg.norm(around - np.roll(around, -1, axis=0), axis=1)
    weights = (lengths + np.roll(lengths, 1)) / max(2 * lengths.sum(), 1e-300)
    return (around * weights[:, None]).sum(axis=0)


def _distance(vertices: np.ndarray, first: np.ndarray, second: np.ndarray) -> float:
    return float(np.linalg.norm(_centre(vertices, first) - _centre(vertices, second)))


def _direction(vertices: np.ndarray, first: np.ndarray, second: np.ndarray) -> np.ndarray:
    along = _centre(vertices, second) - _centre(vertices, first)
    return along / np.linalg.norm(along)


def _principal_extents(vertices: np.ndarray) -> np.ndarray:
    """Extents along the principal axes, largest first, shape (3,)."""
    _, _, axes = np.linalg.svd(vertices - vertices.mean(axis=0), full_matrices=False)
    return np.sort(np.ptp(vertices @ axes.T, axis=0))[::-1]
