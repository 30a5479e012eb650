"""A sheet of props with their names, measures and landmarks."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dgl_assets.props.picture import BACKGROUND, View, draw_prop
from dgl_assets.props.prop import Prop

_INK, _SMALL_INK, _MARK = (52, 50, 48), (112, 108, 104), (206, 58, 52)
_CAPTION, _MARGIN = 64, 20


def draw_prop_sheet(
    props: Sequence[Prop],
    *,
    columns: int = 3,
    size: tuple[int, int] = (460, 360),
    has_landmarks: bool = True,
) -> np.ndarray:
    """Draw props beside each other, each as large as its cell.

    Args:
        props: What to draw, row by row.
        columns: Props in a row.
        size: Width and height of a cell without its caption [pixels].
        has_landmarks: Mark and name the landmarks.

    Returns:
        Picture, shape (H, W, 3), uint8, sRGB.
    """
    if not props or columns < 1 or min(size) < 64:
        raise ValueError(
            "expected at least one prop, one column and cells of 64 pixels; got "
            f"{len(props)} props, {columns} columns and {size}"
        )
    from PIL import Image, ImageDraw, ImageFont

    width, height = size
    columns = min(columns, len(props))
    rows = -(-len(props) // columns)
    page = Image.new(
        "RGB",
        (columns * width + 2 * _MARGIN, rows * (height + _CAPTION) + 2 * _MARGIN),
        BACKGROUND,
    )
    pen = ImageDraw.Draw(page)
    title, small = ImageFont.load_default(size=20), ImageFont.load_default(size=13)
    for index, prop in enumerate(props):
        row, column = divmod(index, columns)
        x, y = _MARGIN + column * width, _MARGIN + row * (height + _CAPTION)
        picture, view = draw_prop(prop, size=size)
        page.paste(Image.fromarray(picture), (x, y))
        if has_landmarks:
            _mark(pen, small, prop, view, (x, y))
        pen.text((x + 24, y + height), prop.kind.replace("_", " "), fill=_INK, font=title)
        pen.text((x + 24, y + height + 26), _describe(prop), fill=_SMALL_INK, font=small)
    return np.array(page)


def _describe(prop: Prop) -> str:
    extent = np.ptp(prop.extent, axis=0)
    measures = " x ".join(f"{100 * e:.4g}" for e in extent.round(3))
    kinds = [shape.kind for shape in prop.shapes]
    shapes = ", ".join(
        f"{kinds.count(kind)} {kind if kinds.count(kind) == 1 else _PLURALS[kind]}"
        for kind in dict.fromkeys(kinds)
    )
    return f"{measures} cm   {prop.mass:.2g} kg   {shapes}"


_PLURALS = {"box": "boxes", "capsule": "capsules", "cylinder": "cylinders", "convex": "convexes"}


def _mark(pen: object, font: object, prop: Prop, view: View, corner: tuple[int, int]) -> None:
    """Mark landmarks by dots and write their names outward; equal places share a dot."""
    names: dict[tuple[float, ...], list[str]] = {}
    for name, place in prop.landmarks.items():
        names.setdefault(tuple(np.round(place, 4)), []).append(name)
    flat = view.project(np.array(list(names)))
    taken: list[tuple[float, float, float, float]] = []
    for (column, row, _), labels in sorted(zip(flat.tolist(), names.values(), strict=True),
                                           key=lambda item: item[0][1]):  # fmt: skip
        x, y = corner[0] + column, corner[1] + row
        pen.ellipse((x - 3.5, y - 3.5, x + 3.5, y + 3.5), fill=_MARK, outline=BACKGROUND)  # pyright: ignore[reportAttributeAccessIssue]
        text = ", ".join(labels)
        length = pen.textlength(text, font=font)  # pyright: ignore[reportAttributeAccessIssue]
        left = x + 8 if column >= view.size[0] / 2 - 4 else x - 8 - length
        left = min(max(left, corner[0] + 2), corner[0] + view.size[0] - length - 2)
        top = y - 17
        while any(left < b and a < left + length and top < d and c < top + 15
                  for a, b, c, d in taken):  # fmt: skip
            top += 5
        taken.append((left, left + length, top, top + 15))
        pen.text((left, top), text, fill=_MARK, font=font, stroke_width=2, stroke_fill=BACKGROUND)  # pyright: ignore[reportAttributeAccessIssue]
