"""Figures of the report: pictures as data URIs, and small charts as SVG."""

import base64
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from dexgarmentlab.reports.page import part
from dgl_collect import Criterion
from dgl_collect.episodes import IMAGE_HEIGHT, IMAGE_WIDTH, Points
from dgl_collect.video import FRAME_RATE, encode_picture

if TYPE_CHECKING:
    from markupsafe import Markup

__all__ = [
    "cloud_figure",
    "file_uri",
    "find_hands",
    "find_wanted",
    "hand_heights",
    "meter",
    "picture_uri",
    "picture_with_points",
]

LEFT_RGB, RIGHT_RGB, BOTH_RGB, CLOTH_RGB = (
    (45, 127, 209),
    (232, 107, 63),
    (134, 66, 168),
    (150, 152, 160),
)
"""Colours of what the left hand wants, the right hand, both and neither."""
CLOUD_WIDTH, CLOUD_HEIGHT, CLOUD_MARGIN = 480, 360, 26
NAMED_FROM = 0.5
"""Affordance from which a point's name is written; those of others show on hovering, to keep it
clear."""
MOVES_FROM = 0.02
"""Distance that a hand which works in a stage covers at least [m]; the other is parked and moves by
less than 1 mm."""
OFF_GARMENT = 0.05
"""Distance from the cloud of a garment from which a point is no longer on it [m]: cloth has been
folded away from there."""
SIDES = ("left", "right")
_MEDIA_TYPES = {".mp4": "video/mp4", ".png": "image/png", ".webp": "image/webp"}


def file_uri(path: Path) -> str:
    """Give a media file as a data URI."""
    return _data_uri(path.read_bytes(), path.suffix)


def picture_uri(image: np.ndarray) -> str:
    """Give a picture of shape (H, W, 3), uint8, as a data URI, small enough to have many."""
    return _data_uri(encode_picture(image, ".webp"), ".webp")


def find_hands(ee_pose: np.ndarray) -> tuple[str, ...]:
    """Tell which hands work in a stage, "left", "right" or both: those that move.

    Args:
        ee_pose: End-effector poses of its frames, left first, shape (T, 2, 7).

    Returns:
        Both where neither moves, as in a stage of one frame.
    """
    covered = np.ptp(ee_pose[:, :, :3], axis=0).max(axis=1)
    hands = tuple(s for s, distance in zip(SIDES, covered, strict=True) if distance >= MOVES_FROM)
    return hands or SIDES


def find_wanted(
    cloud: np.ndarray, affordance: np.ndarray, points: Points, *, hands: Sequence[str] = SIDES
) -> dict[str, str]:
    """Tell by which hand each point of a garment is wanted.

    Args:
        cloud: The garment when the stage begins [m], shape (N, 3), world frame.
        affordance: For the left and the right hand in [0, 1], shape (N, 2).
        points: Named points; those with `xyz` [m] are looked for, where they lay when the episode
            began.
        hands: Those that work in the stage.

    Returns:
        "left", "right", "both" or "other" for each point that is on the garment now.
    """
    wanted = {}
    for name, point in points.items():
        if "xyz" not in point:
            continue
        distances = np.linalg.norm(cloud - point["xyz"], axis=1)
        nearest = int(distances.argmin())
        if distances[nearest] < OFF_GARMENT:
            by = [
                s
                for k, s in enumerate(SIDES)
                if s in hands and affordance[nearest, k] >= NAMED_FROM
            ]
            wanted[name] = "both" if len(by) == 2 else by[0] if by else "other"
    return wanted


def picture_with_points(
    image: np.ndarray, points: Points, *, alt: str, wanted: Mapping[str, str] | None = None
) -> "Markup":
    """Draw an image with found points on it; their names show on hovering, to keep it clear.

    Args:
        image: RGB, shape (480, 640, 3), uint8.
        points: Named points; those with `uv`, a pixel (column, row), are drawn.
        alt: What the picture shows, for those who cannot see it.
        wanted: As of `find_wanted`; points that it lacks are left out. None draws all, in grey.
    """
    hand = dict.fromkeys(points, "other") if wanted is None else wanted
    marks = [
        (name, float(point["uv"][0]), float(point["uv"][1]), hand[name])
        for name, point in points.items()
        if "uv" in point and name in hand
    ]
    return part("picture", picture_uri(image), alt, IMAGE_WIDTH, IMAGE_HEIGHT, marks)


def cloud_figure(
    cloud: np.ndarray,
    affordance: np.ndarray,
    points: Points,
    *,
    alt: str,
    hands: Sequence[str] = SIDES,
) -> "Markup":
    """Draw a garment's cloud from above, or from the front where it hangs, coloured by affordance.

    It is the same way up as the pictures of the environment camera, which looks towards the robots:
        their left is on the
    right, and what lies near them is above.

    Args:
        cloud: Positions [m], shape (N, 3), world frame.
        affordance: Affordance for the left and the right hand in [0, 1], shape (N, 2).
        points: Named points; those on the garment are drawn, those that a hand wants with their
            names.
        alt: What the figure shows.
        hands: Those that work in the stage; the affordance of others is not shown.
    """
    extent = np.ptp(cloud, axis=0)
    axes = [0, 1] if extent[1] >= extent[2] else [0, 2]
    low, size = cloud[:, axes].min(axis=0), np.maximum(extent[axes], 1e-6)
    room = np.array([CLOUD_WIDTH, CLOUD_HEIGHT]) - 2 * CLOUD_MARGIN
    scale = float((room / size).min())
    offset = (np.array([CLOUD_WIDTH, CLOUD_HEIGHT]) - scale * size) / 2

    def project(positions: np.ndarray) -> np.ndarray:
        pixels = (positions[..., axes] - low) * scale + offset
        pixels[..., 0] = CLOUD_WIDTH - pixels[..., 0]
        if axes[1] == 2:
            pixels[..., 1] = CLOUD_HEIGHT - pixels[..., 1]
        return pixels

    weight = np.clip(affordance, 0.0, 1.0) * [side in hands for side in SIDES]
    strength = weight.max(axis=1)
    pixels, colours = project(cloud), _colour_affordance(weight**1.5)
    order = np.argsort(strength)
    canvas = _draw_discs(pixels[order], colours[order])
    uri = _data_uri(encode_picture(canvas, ".png"), ".png")
    wanted = find_wanted(cloud, affordance, points, hands=hands)
    places = {name: project(np.asarray(points[name]["xyz"], float)).tolist() for name in wanted}
    return part(
        "picture",
        uri,
        alt,
        CLOUD_WIDTH,
        CLOUD_HEIGHT,
        [(name, x, y, wanted[name]) for name, (x, y) in places.items()],
        texts=_place_names(places, wanted),
        kind=" cloud",
        radius=7.7,
    )


def _colour_affordance(weight: np.ndarray) -> np.ndarray:
    """Return RGB, shape (N, 3), for weights of the left and right hand in [0, 1], shape (N, 2)."""
    both = weight.min(axis=1, keepdims=True)
    left, right = np.split(weight - both, 2, axis=1)
    neither = 1 - weight.max(axis=1, keepdims=True)
    shares = np.concatenate([left, right, both, neither], axis=1)
    return shares @ np.array([LEFT_RGB, RIGHT_RGB, BOTH_RGB, CLOTH_RGB])


def hand_heights(stages: Sequence[tuple[str, np.ndarray]]) -> "Markup":
    """Chart the height of both hands over the recorded frames; a parked hand is drawn faintly.

    Args:
        stages: Name and end-effector poses, shape (T, 2, 7), of each stage.
    """
    width, height, top, bottom, left = 720, 190, 26, 24, 44
    heights = np.concatenate([poses[:, :, 2] for _, poses in stages])  # (sum of T, 2)
    ceiling = max(0.1, float(np.ceil(heights.max() * 10) / 10))
    floor = min(0.0, float(np.floor(heights.min() * 10) / 10))
    step = (width - left) / len(heights)

    def y(value: float) -> float:
        return top + (height - top - bottom) * (1 - (value - floor) / (ceiling - floor))

    bands, lines, first = [], [], 0
    for name, poses in stages:
        x, count, working = left + first * step, len(poses), find_hands(poses)
        bands.append((name, x, count * step, height - top - bottom))
        for hand, side in enumerate(SIDES):
            points = [
                (x + (frame + 0.5) * step, y(float(poses[frame, hand, 2])))
                for frame in range(count)
            ]
            lines.append((side if side in working else f"{side} parked", points))
        first += count
    ticks = [(value, y(value)) for value in (floor, (floor + ceiling) / 2, ceiling)]
    seconds = len(heights) / FRAME_RATE
    return part("heights", width, height, bands, lines, ticks, seconds, left, top)


def meter(criterion: Criterion) -> "Markup":
    """Draw a measured value against its threshold."""
    values = (criterion.value, criterion.threshold)
    low = min(0.0, *values)
    high = 1.0 if not criterion.unit and 0.3 < max(values) <= 1.0 else max(values) * 1.3
    span = max(high - low, 1e-9)
    filled, limit = ((value - low) / span * 100 for value in values)
    return part("meter", criterion, filled, limit)


def _draw_discs(pixels: np.ndarray, colours: np.ndarray, *, radius: int = 3) -> np.ndarray:
    """Draw discs, later ones on top, on a transparent canvas of twice the figure's size."""
    canvas = np.zeros((2 * CLOUD_HEIGHT, 2 * CLOUD_WIDTH, 4), np.uint8)
    rows, columns = np.mgrid[-radius : radius + 1, -radius : radius + 1]
    inside = rows**2 + columns**2 <= radius**2 + 1
    rows, columns = rows[inside], columns[inside]
    centres = np.round(2 * pixels).astype(int)
    y = np.clip(centres[:, 1, None] + rows, 0, canvas.shape[0] - 1)
    x = np.clip(centres[:, 0, None] + columns, 0, canvas.shape[1] - 1)
    rgba = np.concatenate([colours, np.full((len(colours), 1), 235.0)], axis=1).astype(np.uint8)
    canvas[y, x] = rgba[:, None, :]
    return canvas


def _place_names(
    places: Mapping[str, Sequence[float]], wanted: Mapping[str, str]
) -> list[tuple[str, float, float, float]]:
    """Find room for the names of the points that a hand wants: name, x, baseline and size [px]."""
    line, gap = 18.7, 13.2
    taken = [(x - gap / 2, y - gap / 2, x + gap / 2, y + gap / 2) for x, y in places.values()]
    texts = []
    for name in [name for name, hand in wanted.items() if hand != "other"]:
        x, y = places[name]
        length = 0.6 * line * len(name)
        # Outwards if possible, and beside the disc rather than below or above.
        sides = (x - gap - length, x + gap)[:: 1 if x < CLOUD_WIDTH / 2 else -1]
        corners = [
            (min(max(left, 0.0), CLOUD_WIDTH - length), y + (step - 0.5) * line)
            for step in (0, 1, -1, 2, -2, 3, -3)
            for left in sides
        ]
        boxes = [(left, top, left + length, top + line) for left, top in corners]
        box = next((box for box in boxes if _has_room(box, taken)), boxes[0])
        taken.append(box)
        texts.append((name, box[0], box[1] + 0.78 * line, line))
    return texts


def _has_room(
    box: tuple[float, float, float, float], taken: Sequence[tuple[float, float, float, float]]
) -> bool:
    """Say whether a box (left, top, right, bottom) is in the figure and on none of the others."""
    left, top, right, bottom = box
    return (
        top >= 0
        and bottom <= CLOUD_HEIGHT
        and not any(left < r and l < right and top < b and t < bottom for l, t, r, b in taken)
    )


def _data_uri(content: bytes, suffix: str) -> str:
    return f"data:{_MEDIA_TYPES[suffix]};base64,{base64.b64encode(content).decode()}"
