"""Contact sheets: many garments in one picture, drawn without a GPU.

Each garment is seen from above as it lies, textured with a fabric at its real scale, at one scale for the whole sheet.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from dgl_assets.fabrics import Fabric, make_fabric
from dgl_assets.garments.garment import Garment

if TYPE_CHECKING:
    from PIL import Image

_OVERSAMPLING = 3
_BACKGROUND = (246, 244, 240)
_SEAM, _INSIDE, _MARK = (40, 38, 36), 0.62, (220, 30, 40)
_FLAP_LIGHT = 0.10  # a leaf of a collar catches more light than the front below it
_MARGIN = 0.06  # of a cell


def draw_garment(
    garment: Garment,
    *,
    fabric: Fabric,
    size: int = 256,
    metres: float | None = None,
    has_landmarks: bool = False,
) -> np.ndarray:
    """Draw one garment from above.

    Args:
        garment: What to draw.
        fabric: Its cloth.
        size: Width and height of the picture [pixels].
        metres: What the picture spans [m]; None fits the garment.
        has_landmarks: Mark the landmarks.

    Returns:
        Picture, shape (size, size, 3), uint8, sRGB; +x to the right, +y up.
    """
    from PIL import Image, ImageDraw

    span = float(garment.extent[:2].max()) if metres is None else metres
    side = size * _OVERSAMPLING
    scale = side * (1 - 2 * _MARGIN) / span
    pixels = garment.vertices[:, :2] * scale * [1, -1] + side / 2
    faces = Image.new("I", (side, side), 0)
    pen = ImageDraw.Draw(faces)
    order = np.argsort(garment.vertices[garment.faces, 2].mean(axis=1), kind="stable")
    for face in order:  # from below upward
        corners = [tuple(point) for point in pixels[garment.faces[face]].tolist()]
        pen.polygon(corners, fill=int(face) + 1)
    image = Image.fromarray(_shade(garment, fabric, np.array(faces), pixels))
    _draw_seams(image, garment, np.array(faces), pixels)
    if has_landmarks:
        pen = ImageDraw.Draw(image)
        radius = 1.6 * _OVERSAMPLING
        for x, y in pixels[list(garment.landmarks.values())].tolist():
            pen.ellipse((x - radius, y - radius, x + radius, y + radius), fill=_MARK)
    return np.array(image.resize((size, size), Image.Resampling.LANCZOS))


def draw_contact_sheet(
    garments: Sequence[Garment],
    *,
    columns: int = 8,
    size: int = 224,
    seed: int = 0,
    is_common_scale: bool = True,
    has_landmarks: bool = False,
) -> np.ndarray:
    """Draw garments beside each other.

    Args:
        garments: What to draw, row by row.
        columns: Garments in a row.
        size: Side of one cell [pixels].
        seed: Seed of the fabrics.
        is_common_scale: Draw all garments at one scale, rather than each as large as its cell.
        has_landmarks: Mark the landmarks.

    Returns:
        Picture, shape (rows * size, columns * size, 3), uint8, sRGB.

    Raises:
        ValueError: If there is no garment, or `columns` or `size` are not positive.
    """
    if not garments or columns < 1 or size < 16:
        raise ValueError(
            "expected at least one garment, one column and 16 pixels; got "
            f"{len(garments)} garments, {columns} columns and {size} pixels"
        )
    metres = max(float(g.extent[:2].max()) for g in garments) if is_common_scale else None
    columns = min(columns, len(garments))
    rows = -(-len(garments) // columns)
    sheet = np.empty((rows * size, columns * size, 3), dtype=np.uint8)
    sheet[:] = _BACKGROUND
    for index, garment in enumerate(garments):
        row, column = divmod(index, columns)
        sheet[row * size : (row + 1) * size, column * size : (column + 1) * size] = draw_garment(
            garment,
            fabric=make_fabric([seed, index]),
            size=size,
            metres=metres,
            has_landmarks=has_landmarks,
        )
    return sheet


def save_picture(picture: np.ndarray, path: Path) -> Path:
    """Write a picture as PNG; the file appears whole.

    Args:
        picture: Shape (H, W, 3), uint8, sRGB.
        path: Where to.

    Returns:
        The path.
    """
    from PIL import Image

    path.parent.mkdir(parents=True, exist_ok=True)
    handle, beside = tempfile.mkstemp(dir=path.parent, suffix=".part")
    try:
        with os.fdopen(handle, "wb") as file:
            Image.fromarray(picture).save(file, format="PNG")
        Path(beside).replace(path)
    except BaseException:
        Path(beside).unlink(missing_ok=True)
        raise
    return path


def _shade(garment: Garment, fabric: Fabric, faces: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    image = np.empty((*faces.shape, 3), dtype=np.uint8)
    image[:] = _BACKGROUND
    row, column = np.nonzero(faces)
    face = faces[row, column] - 1
    corners = garment.faces[face]
    weights = _compute_weights(np.stack([column + 0.5, row + 0.5], axis=1), pixels[corners])
    uv = fabric.compute_uvs(garment.rest_vertices[:, :2])
    place = (uv[corners] * weights[..., None]).sum(axis=1) * len(fabric.texture)
    texel = np.floor(place).astype(int) % len(fabric.texture)
    colour = fabric.texture[texel[:, 1], texel[:, 0]].astype(np.float64)
    edge = garment.vertices[garment.faces].astype(np.float64)
    normal = np.cross(edge[:, 1] - edge[:, 0], edge[:, 2] - edge[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    light = (
        0.93
        + 0.5 * (np.abs(normal) @ [0.0, 0.0, 1.0] - 1)
        + 0.25 * normal[:, 0] * np.sign(normal[:, 2])
    )
    is_inside = garment.canonical[garment.faces, 2].sum(axis=1) < 0
    light = np.where(is_inside, _INSIDE, light)
    flaps = [index for index, name in enumerate(garment.panels) if name.endswith("_flap")]
    light = np.where(np.isin(garment.face_panels, flaps), light + _FLAP_LIGHT, light)
    image[row, column] = np.clip(colour * light[face, None], 0, 255).astype(np.uint8)
    return image


def _compute_weights(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    first, second = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    offset = points - triangles[:, 0]
    area = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]
    area = np.where(np.abs(area) < 1e-9, 1.0, area)
    b1 = (offset[:, 0] * second[:, 1] - offset[:, 1] * second[:, 0]) / area
    b2 = (first[:, 0] * offset[:, 1] - first[:, 1] * offset[:, 0]) / area
    return np.stack([1 - b1 - b2, b1, b2], axis=1)


def _draw_seams(
    image: Image.Image, garment: Garment, faces: np.ndarray, pixels: np.ndarray
) -> None:
    """Darken seams and openings where they are seen."""
    from PIL import Image, ImageDraw

    lines = Image.new("L", image.size, 0)
    pen = ImageDraw.Draw(lines)
    half = np.concatenate([garment.faces[:, [k, (k + 1) % 3]] for k in range(3)])
    owner = np.tile(np.arange(len(garment.faces)), 3)
    _, edge, counts = np.unique(
        np.sort(half, axis=1), axis=0, return_inverse=True, return_counts=True
    )
    panel = garment.face_panels[owner].astype(np.float64)
    edge = edge.ravel()
    mean = np.bincount(edge, panel) / counts
    is_drawn = (counts[edge] == 1) | (mean[edge] != panel)
    centres = pixels[garment.faces].mean(axis=1)
    for ends, face in zip(half[is_drawn], owner[is_drawn], strict=True):
        if _is_seen(faces, int(face), centres[face]):
            pen.line(pixels[ends].ravel().tolist(), fill=150, width=_OVERSAMPLING - 1)
    image.paste(_SEAM, mask=lines)


def _is_seen(faces: np.ndarray, face: int, centre: np.ndarray) -> bool:
    column, row = np.clip(centre.astype(int), 0, faces.shape[0] - 1)
    return bool(faces[row, column] == face + 1)
