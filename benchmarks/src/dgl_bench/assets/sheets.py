"""Contact sheets of garments: as made, after the drop, and those strained most."""

import zlib
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from dgl_assets import Garment, draw_contact_sheet, load_garment
from dgl_bench.assets.attempts import Attempt, find_positions

__all__ = ["COLUMNS", "draw_sheet", "load_dropped"]

COLUMNS = 8
SIZE = 200
"""Side of a cell [pixels]."""
STRIP = 20
"""Height of the labels below a row [pixels]."""
_INK = (96, 94, 90)


def load_dropped(folder: Path, attempt: Attempt) -> Garment:
    """Make a garment again, as it came to lie in a run.

    Raises:
        ValueError: If the run kept no positions of it, or of another mesh.
    """
    path = find_positions(folder, attempt.id)
    if not path.is_file():
        raise ValueError(f"{folder} holds no positions of {attempt.id}")
    positions = np.load(path, allow_pickle=False)
    garment = load_garment(attempt.id)
    if positions.shape != garment.vertices.shape:
        raise ValueError(
            f"{path} must hold {garment.vertices.shape} numbers, as the generator makes "
            f"{attempt.id}; "
            f"got {positions.shape}"
        )
    return replace(garment, vertices=positions)


def draw_sheet(garments: Sequence[Garment], labels: Sequence[str] = ()) -> np.ndarray:
    """Draw garments of a category beside each other, with a label below each where there are some.

    The fabrics are those of the category and the place, so that the same garments are alike on two
    sheets.

    Returns:
        Picture, shape (H, W, 3), uint8, sRGB: rows of `SIZE` pixels, and `STRIP` more with labels.
    """
    from PIL import Image, ImageDraw, ImageFont

    columns = min(COLUMNS, len(garments))
    seed = zlib.crc32(garments[0].category.encode())
    sheet = draw_contact_sheet(garments, columns=columns, size=SIZE, seed=seed)
    if not labels:
        return sheet
    rows = sheet.reshape(-1, SIZE, *sheet.shape[1:])
    strip = np.broadcast_to(sheet[0, 0], (len(rows), STRIP, *sheet.shape[1:]))
    image = Image.fromarray(np.concatenate([rows, strip], axis=1).reshape(-1, *sheet.shape[1:]))
    pen, font = ImageDraw.Draw(image), ImageFont.load_default(size=12)
    for index, label in enumerate(labels):
        row, column = divmod(index, columns)
        place = ((column + 0.5) * SIZE, (row + 1) * (SIZE + STRIP) - STRIP / 2)
        pen.text(place, label, fill=_INK, font=font, anchor="mm")
    return np.array(image)
