"""Contact sheet of training data: a row of views for each garment, coloured by place."""

from pathlib import Path

import numpy as np

from dgl_gam.data import GarmentData, GarmentFolder

__all__ = ["draw_data_sheet"]

_CELL, _STRIP = 150, 16  # side of a cell and height of its label [pixels]
_PAPER, _INK = (250, 249, 246), (70, 68, 64)


def draw_data_sheet(folder: Path, path: Path, *, garments: int = 2) -> int:
    """Draw views of the first garments of each category.

    The hue is the place across (u, from red at the left to blue at the right), the lightness that
    along (v); the back is darker than the front.

    Args:
        folder: Of the data set.
        path: Picture to write, PNG: beside its place, then renamed.
        garments: How many of each category, at most.

    Returns:
        Number of garments that are drawn.
    """
    from PIL import Image, ImageDraw, ImageFont

    from dgl_files.whole import written_beside

    data = GarmentFolder(folder)
    rows = [
        data.load(index)
        for category in data.categories
        for index in list(data.get_indices(category))[:garments]
    ]
    columns = max(len(row.view_state) for row in rows)
    sheet = Image.new("RGB", (columns * _CELL, len(rows) * (_CELL + _STRIP)), _PAPER)
    pen, font = ImageDraw.Draw(sheet), ImageFont.load_default(size=10)
    for r, garment in enumerate(rows):
        for view, state in enumerate(garment.view_state):
            corner = (view * _CELL, r * (_CELL + _STRIP))
            sheet.paste(Image.fromarray(_draw_view(garment, view)), corner)
            label = garment.header.state_names[state]
            if view == 0:
                label = garment.header.garment_id
            pen.text((corner[0] + 4, corner[1] + _CELL), label, fill=_INK, font=font)
    with written_beside(path) as beside:
        sheet.save(beside)
    return len(rows)


def _draw_view(garment: GarmentData, view: int) -> np.ndarray:
    """Draw the points as the camera has them, shape (`_CELL`, `_CELL`, 3), uint8."""
    direction = np.array(garment.header.view_directions[view])
    reference = np.array([0.0, 1.0, 0.0]) if direction[2] > 0.99 else np.array([0.0, 0.0, 1.0])
    right = np.cross(reference, direction)
    right /= np.linalg.norm(right)
    points = garment.view_points[view].astype(np.float64)
    image = np.column_stack([points @ right, points @ np.cross(direction, right)])
    image -= (image.min(axis=0) + image.max(axis=0)) / 2
    scale = 0.46 * _CELL / max(np.abs(image).max() * 1.0, 1e-6)
    at = np.round(image * [scale, -scale] + _CELL / 2).astype(int)
    colours = _colour(garment)[garment.view_vertices[view]]
    picture = np.full((_CELL, _CELL, 3), _PAPER, np.uint8)
    order = np.argsort(points @ direction)  # the nearest last
    for dx, dy in ((0, 0), (1, 0), (0, 1), (1, 1)):
        x, y = np.clip(at[order] + [dx, dy], 0, _CELL - 1).T
        picture[y, x] = colours[order]
    return picture


def _colour(garment: GarmentData) -> np.ndarray:
    """Compute vertex colours by canonical coordinates, or by flat position, shape (V, 3)."""
    import matplotlib as mpl

    place = garment.canonical if garment.has_canonical else garment.states[0]
    low, high = place[:, :2].min(axis=0), place[:, :2].max(axis=0)
    u, v = ((place[:, :2] - low) / np.maximum(high - low, 1e-9)).T
    shade = (0.55 + 0.45 * v) * np.where(garment.canonical[:, 2] < 0, 0.6, 1.0)
    colours = mpl.colormaps["turbo"](0.95 - 0.9 * u)[:, :3] * shade[:, None]
    return np.round(255 * colours).astype(np.uint8)
