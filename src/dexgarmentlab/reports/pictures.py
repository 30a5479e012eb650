"""The final pictures of many attempts, beside each other."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dexgarmentlab.reports.figures import picture_uri
from dgl_collect.results import AttemptResult
from dgl_files.whole import written_beside

__all__ = ["Shot", "draw_sheet", "load_gallery", "make_shot"]

WIDTH, HEIGHT = 240, 180
"""Size of a small picture [pixels]."""
COLUMNS = 10
"""Pictures beside each other on a sheet."""
LEAST_CROPPED = 5
"""Of so many pictures, only the part is shown in which they differ."""
_CHANGE, _OUTLIERS, _ROOM = 24, 0.01, 0.04  # of 255; share of what differs; share of the picture
_FRAME, _STRIP, _GAP = 4, 26, 10
_PAPER, _INK, _GOOD, _BAD = (255, 255, 255), (60, 60, 66), (31, 122, 77), (196, 60, 40)


Box = tuple[float, float, float, float]


@dataclass(frozen=True, kw_only=True)
class Shot:
    """An attempt's final picture."""

    path: Path
    """PNG of 4 : 3."""
    label: str
    """Text below the picture."""
    success: bool
    """True if the attempt succeeded."""
    link: str | None = None
    """Address of the film, relative to the page."""


def make_shot(result: AttemptResult, folder: Path, *, link: str | None = None) -> Shot:
    """Tell of an attempt's final picture, with its number and value.

    Args:
        result: What became of the attempt; it has a picture.
        folder: Of its run.
        link: Address of its film, relative to the page.
    """
    value = "" if result.value is None else f" · {result.value:.2f}"
    path = folder / result.files["picture"]
    return Shot(path=path, label=f"{result.index}{value}", success=result.success, link=link)


def load_gallery(shots: Sequence[Shot]) -> list[tuple[Shot, str]]:
    """Load small copies of all pictures, as data URIs, for the macro `gallery`.

    Raises:
        OSError: If a picture cannot be read.
    """
    if not shots:
        return []
    return [(shot, picture_uri(small)) for shot, small in zip(shots, _load(shots), strict=True)]


def draw_sheet(shots: Sequence[Shot], path: Path) -> Path:
    """Draw all pictures into one, failed ones framed in red, for use where a page cannot be shown.

    Args:
        shots: At least one.
        path: JPEG to write.

    Returns:
        The path.

    Raises:
        ValueError: If there are none.
        OSError: If a picture cannot be read.
    """
    from PIL import Image, ImageDraw, ImageFont

    if not shots:
        raise ValueError("shots must be at least one picture; got none")
    columns = min(COLUMNS, len(shots))
    rows = -(-len(shots) // columns)
    step = (WIDTH + 2 * _FRAME + _GAP, HEIGHT + 2 * _FRAME + _STRIP + _GAP)
    sheet = Image.new("RGB", (columns * step[0] + _GAP, rows * step[1] + _GAP), _PAPER)
    pen, font = ImageDraw.Draw(sheet), ImageFont.load_default(size=15)
    for index, (shot, small) in enumerate(zip(shots, _load(shots), strict=True)):
        row, column = divmod(index, columns)
        x, y = _GAP + column * step[0], _GAP + row * step[1]
        box = (x, y, x + WIDTH + 2 * _FRAME - 1, y + HEIGHT + 2 * _FRAME - 1)
        pen.rectangle(box, fill=_GOOD if shot.success else _BAD)
        sheet.paste(Image.fromarray(small), (x + _FRAME, y + _FRAME))
        below = (x + _FRAME, y + HEIGHT + 2 * _FRAME + _STRIP / 2)
        pen.text(below, shot.label, fill=_INK, font=font, anchor="lm")
    with written_beside(path) as partial:
        sheet.save(partial, format="JPEG", quality=85)
    return path


def _load(shots: Sequence[Shot]) -> list[np.ndarray]:
    """Load small copies of the differing part of pictures, each (HEIGHT, WIDTH, 3), uint8."""
    whole = [_read(shot.path) for shot in shots]
    box = _find_box(np.stack(whole))
    return [_read(shot.path, box) for shot in shots]


def _read(path: Path, box: Box = (0.0, 0.0, 1.0, 1.0)) -> np.ndarray:
    """Read a part of a picture, made small, shape (HEIGHT, WIDTH, 3), uint8."""
    from PIL import Image

    with Image.open(path) as image:
        width, height = image.size
        pixels = (box[0] * width, box[1] * height, box[2] * width, box[3] * height)
        small = image.convert("RGB").resize((WIDTH, HEIGHT), Image.Resampling.LANCZOS, box=pixels)
    return np.asarray(small)


def _find_box(pictures: np.ndarray) -> Box:
    """Find the box in which pictures of one camera differ; the whole for few or equal pictures.

    Args:
        pictures: Shape (N, H, W, 3), uint8.

    Returns:
        Left, upper, right and lower edge as shares of width and height; as wide as high, and inside
        the picture.
    """
    if len(pictures) < LEAST_CROPPED:
        return (0.0, 0.0, 1.0, 1.0)
    scene = np.median(pictures, axis=0)
    weight = (np.abs(pictures - scene).max(axis=-1) > _CHANGE).sum(axis=0)
    if not weight.any():
        return (0.0, 0.0, 1.0, 1.0)
    ends = []
    for along in (weight.sum(axis=0), weight.sum(axis=1)):  # by columns, by rows
        share = np.cumsum(along) / along.sum()
        # garments that have been carried away are few, and do not make the others small
        low, high = np.searchsorted(share, [_OUTLIERS, 1 - _OUTLIERS])
        ends.append(((low - 0.5) / len(along), (high + 1.5) / len(along)))
    side = min(1.0, max(high - low for low, high in ends) + 2 * _ROOM)
    starts = [min(max((low + high - side) / 2, 0.0), 1 - side) for low, high in ends]
    return (starts[0], starts[1], starts[0] + side, starts[1] + side)
