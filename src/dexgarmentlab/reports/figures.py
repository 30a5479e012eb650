"""Figures of the report: pictures as data URIs, and small charts as SVG."""

import base64
import html
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from dgl_collect import Criterion
from dgl_collect.episodes import IMAGE_HEIGHT, IMAGE_WIDTH, Points
from dgl_collect.video import FRAME_RATE, encode_picture

__all__ = [
    "cloud_figure",
    "file_uri",
    "find_hands",
    "find_wanted",
    "format_number",
    "hand_heights",
    "meter",
    "picture_uri",
    "picture_with_points",
    "time_bar",
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


def format_number(value: float) -> str:
    """Write a number with three significant digits, without an exponent where people would not."""
    if value == 0 or not 1e-4 <= abs(value) < 1e6:
        return f"{value:.3g}"
    digits = max(0, 2 - int(np.floor(np.log10(abs(value)))))
    text = f"{value:.{digits}f}"
    return (text.rstrip("0").rstrip(".") if digits else text).replace("-", "\u2212")


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
) -> str:
    """Draw an image with found points on it; their names show on hovering, to keep it clear.

    Args:
        image: RGB, shape (480, 640, 3), uint8.
        points: Named points; those with `uv`, a pixel (column, row), are drawn.
        alt: What the picture shows, for those who cannot see it.
        wanted: As of `find_wanted`; points that it lacks are left out. None draws all, in grey.
    """
    uri = picture_uri(image)
    hand = dict.fromkeys(points, "other") if wanted is None else wanted
    marks = "".join(
        _disc(name, float(point["uv"][0]), float(point["uv"][1]), hand=hand[name], size=0.9)
        for name, point in points.items()
        if "uv" in point and name in hand
    )
    return (
        f'<span class="picture"><img src="{uri}" alt="{html.escape(alt)}" width="{IMAGE_WIDTH}" '
        f'height="{IMAGE_HEIGHT}"><svg viewBox="0 0 {IMAGE_WIDTH} {IMAGE_HEIGHT}" '
        f'aria-hidden="true">{marks}</svg></span>'
    )


def cloud_figure(
    cloud: np.ndarray,
    affordance: np.ndarray,
    points: Points,
    *,
    alt: str,
    hands: Sequence[str] = SIDES,
) -> str:
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
    return (
        f'<span class="picture cloud"><img src="{uri}" alt="{html.escape(alt)}" '
        f'width="{CLOUD_WIDTH}" height="{CLOUD_HEIGHT}">'
        f'<svg viewBox="0 0 {CLOUD_WIDTH} {CLOUD_HEIGHT}" aria-hidden="true">'
        f"{_marks(places, wanted, size=1.1)}</svg></span>"
    )


def _colour_affordance(weight: np.ndarray) -> np.ndarray:
    """Return RGB, shape (N, 3), for weights of the left and right hand in [0, 1], shape (N, 2)."""
    both = weight.min(axis=1, keepdims=True)
    left, right = np.split(weight - both, 2, axis=1)
    neither = 1 - weight.max(axis=1, keepdims=True)
    shares = np.concatenate([left, right, both, neither], axis=1)
    return shares @ np.array([LEFT_RGB, RIGHT_RGB, BOTH_RGB, CLOTH_RGB])


def hand_heights(stages: Sequence[tuple[str, np.ndarray]]) -> str:
    """Chart the height of both hands over the recorded frames; a parked hand is drawn faintly.

    Args:
        stages: Name and end-effector poses, shape (T, 2, 7), of each stage.
    """
    width, height, top, bottom, left = 720.0, 190.0, 26.0, 24.0, 44.0
    heights = np.concatenate([poses[:, :, 2] for _, poses in stages])  # (sum of T, 2)
    ceiling = max(0.1, float(np.ceil(heights.max() * 10) / 10))
    floor = min(0.0, float(np.floor(heights.min() * 10) / 10))
    step = (width - left) / len(heights)

    def y(value: float) -> float:
        return top + (height - top - bottom) * (1 - (value - floor) / (ceiling - floor))

    parts, first = [], 0
    for number, (name, poses) in enumerate(stages):
        x, count = left + first * step, len(poses)
        parts.append(
            f'<rect class="band{number % 2}" x="{x:.1f}" y="{top}" width="{count * step:.1f}" '
            f'height="{height - top - bottom}"/>'
            f'<text x="{x + 8:.1f}" y="{top - 9}">{html.escape(_words(name))}</text>'
        )
        working = find_hands(poses)
        for hand, side in enumerate(SIDES):
            line = " ".join(
                f"{x + (frame + 0.5) * step:.1f},{y(float(poses[frame, hand, 2])):.1f}"
                for frame in range(count)
            )
            state = side if side in working else f"{side} parked"
            parts.append(f'<polyline class="{state}" points="{line}"/>')
        first += count
    for value in (floor, (floor + ceiling) / 2, ceiling):
        parts.append(
            f'<text class="tick" x="{left - 8}" y="{y(value) + 4:.1f}">{value:.2f}</text>'
            f'<line x1="{left}" x2="{width}" y1="{y(value):.1f}" y2="{y(value):.1f}"/>'
        )
    seconds = len(heights) / FRAME_RATE
    parts.append(
        f'<text x="{left}" y="{height - 6}">0 s</text>'
        f'<text class="tick" x="{width}" y="{height - 6}">{seconds:.1f} s recorded</text>'
    )
    return (
        f'<svg class="chart" viewBox="0 0 {width:g} {height:g}" role="img" '
        f'aria-label="height of both hands in metres over time">{"".join(parts)}</svg>'
    )


def meter(criterion: Criterion) -> str:
    """Draw a measured value against its threshold."""
    values = (criterion.value, criterion.threshold)
    low = min(0.0, *values)
    high = 1.0 if not criterion.unit and 0.3 < max(values) <= 1.0 else max(values) * 1.3
    span = max(high - low, 1e-9)
    filled, limit = ((value - low) / span * 100 for value in values)
    unit = f" {criterion.unit}" if criterion.unit else ""
    state = "met" if criterion.is_met else "missed"
    return (
        f'<div class="meter {state}"><div class="meter-text"><span>{html.escape(criterion.name)}'
        f"</span><span><b>{format_number(criterion.value)}{html.escape(unit)}</b>"
        f'<span class="quiet"> needs {_sign(criterion.comparison)} '
        f"{format_number(criterion.threshold)}{html.escape(unit)}</span></span></div>"
        f'<div class="track"><i style="width:{filled:.1f}%"></i>'
        f'<u style="left:{limit:.1f}%"></u></div></div>'
    )


def time_bar(stage_seconds: Mapping[str, float], total: float) -> str:
    """Draw how the time of an attempt divides into its stages and the rest."""
    rest = max(0.0, total - sum(stage_seconds.values()))
    parts = [*stage_seconds.items(), ("all else", rest)]
    whole = max(sum(seconds for _, seconds in parts), 1e-9)
    bars = "".join(
        f'<i class="part{number % 4}" style="width:{seconds / whole:.2%}"></i>'
        if number < len(stage_seconds)
        else f'<i class="rest" style="width:{seconds / whole:.2%}"></i>'
        for number, (_, seconds) in enumerate(parts)
    )
    legend = "".join(
        f'<li class="{"rest" if number == len(stage_seconds) else f"part{number % 4}"}">'
        f"{html.escape(_words(name))} <b>{seconds:.1f} s</b></li>"
        for number, (name, seconds) in enumerate(parts)
    )
    return f'<div class="times"><div class="stack">{bars}</div><ul>{legend}</ul></div>'


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


def _marks(places: Mapping[str, Sequence[float]], wanted: Mapping[str, str], *, size: float) -> str:
    """Draw discs at pixels (x, y), and the names of grasped points where there is room."""
    line, gap = 17 * size, 12 * size
    taken = [(x - gap / 2, y - gap / 2, x + gap / 2, y + gap / 2) for x, y in places.values()]
    marks = ""
    for name in [name for name, hand in wanted.items() if hand != "other"]:
        (x, y), text = places[name], _words(name)
        length = 0.6 * line * len(text)
        # Outwards if possible, away from the other hand's point, and beside the disc rather than
        # below or above.
        sides = (x - gap - length, x + gap)[:: 1 if x < CLOUD_WIDTH / 2 else -1]
        corners = [
            (min(max(left, 0.0), CLOUD_WIDTH - length), y + (step - 0.5) * line)
            for step in (0, 1, -1, 2, -2, 3, -3)
            for left in sides
        ]
        boxes = [(left, top, left + length, top + line) for left, top in corners]
        box = next((box for box in boxes if _has_room(box, taken)), boxes[0])
        taken.append(box)
        marks += (
            f'<text x="{box[0]:.1f}" y="{box[1] + 0.78 * line:.1f}" font-size="{line:g}">'
            f"{html.escape(text)}</text>"
        )
    return marks + "".join(
        _disc(name, x, y, hand=wanted[name], size=size) for name, (x, y) in places.items()
    )


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


def _disc(name: str, x: float, y: float, *, hand: str, size: float) -> str:
    return (
        f'<g class="mark {hand}"><circle cx="{x:.1f}" cy="{y:.1f}" r="{7 * size:g}">'
        f"<title>{html.escape(_words(name))}</title></circle></g>"
    )


def _words(name: str) -> str:
    return name.replace("_", " ")


def _sign(comparison: str) -> str:
    return {"<": "&lt;", "<=": "≤", ">": "&gt;", ">=": "≥"}[comparison]


def _data_uri(content: bytes, suffix: str) -> str:
    return f"data:{_MEDIA_TYPES[suffix]};base64,{base64.b64encode(content).decode()}"
