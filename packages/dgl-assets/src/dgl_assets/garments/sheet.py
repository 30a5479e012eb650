"""Contact sheets: many garments in one picture of one scale, drawn without a GPU.

Cloth is seen from above as it lies, textured with a fabric at its real scale; hats and gloves
obliquely, in the fabric's mean colour.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from dgl_assets.garments.garment import Garment
from dgl_assets.garments.meshing import compute_vertex_normals
from dgl_assets.garments.view import project
from dgl_assets.materials import PALE, MaterialMaps, sample_fabric_material
from dgl_files.whole import written_beside

if TYPE_CHECKING:
    from PIL import Image

_OVERSAMPLING = 3
_BACKGROUND = (246, 244, 240)
_SEAM, _INSIDE, _MARK = (40, 38, 36), 0.62, (220, 30, 40)
_LIGHT = np.array([-0.45, 0.65, 0.62])  # on shells: from the left and above, in the picture's frame
_SEAM_STRENGTH = {True: 110, False: 150}  # thinner on shells, which are drawn larger
_FLAP_LIGHT = 0.10  # a leaf of a collar catches more light than the front below it
_MARGIN = 0.06  # of a cell
_TEXELS = 128  # along a tile of fabric, about as fine as a sheet's pixels


def draw_garment(
    garment: Garment,
    *,
    fabric: MaterialMaps,
    size: int = 256,
    metres: float | None = None,
    has_landmarks: bool = False,
    has_names: bool = False,
) -> np.ndarray:
    """Draw one garment: cloth from above, an elastic shell obliquely.

    Args:
        garment: A garment.
        fabric: Its cloth.
        size: Width and height of the picture [pixels].
        metres: Width of the picture [m]; None fits the garment.
        has_landmarks: Mark the landmarks; rings are on the side away from the viewer.
        has_names: Write the names of the landmarks; legible from 800 pixels.

    Returns:
        Picture, shape (size, size, 3), uint8, sRGB; of cloth +x is to the right, +y up.
    """
    from PIL import Image, ImageDraw

    view = project(garment)
    span = _measure_span(garment) if metres is None else metres
    side = size * _OVERSAMPLING
    scale = side * (1 - 2 * _MARGIN) / span
    pixels = view[:, :2] * scale * [1, -1] + side / 2
    faces = Image.new("I", (side, side), 0)
    pen = ImageDraw.Draw(faces)
    order = np.argsort(view[garment.faces, 2].mean(axis=1), kind="stable")
    for face in order:  # towards the viewer
        corners = [tuple(point) for point in pixels[garment.faces[face]].tolist()]
        pen.polygon(corners, fill=int(face) + 1)
    image = Image.fromarray(_shade(garment, fabric, np.array(faces), pixels, view))
    _draw_seams(image, garment, np.array(faces), pixels)
    if has_landmarks:
        _mark_landmarks(image, garment, pixels, view)
    if has_names:
        _write_names(image, garment, pixels)
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
        garments: Garments, row by row.
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
    metres = max(map(_measure_span, garments)) if is_common_scale else None
    columns = min(columns, len(garments))
    rows = -(-len(garments) // columns)
    sheet = np.empty((rows * size, columns * size, 3), dtype=np.uint8)
    sheet[:] = _BACKGROUND
    for index, garment in enumerate(garments):
        row, column = divmod(index, columns)
        sheet[row * size : (row + 1) * size, column * size : (column + 1) * size] = draw_garment(
            garment,
            fabric=sample_fabric_material([seed, index], avoid=PALE).render(_TEXELS),
            size=size,
            metres=metres,
            has_landmarks=has_landmarks,
        )
    return sheet


def save_picture(picture: np.ndarray, path: Path) -> Path:
    """Write a picture as PNG; the file appears whole.

    Args:
        picture: Shape (H, W, 3), uint8, sRGB.
        path: Path of the file.

    Returns:
        The path.
    """
    from PIL import Image

    with written_beside(path) as beside:
        Image.fromarray(picture).save(beside, format="PNG")
    return path


def _measure_span(garment: Garment) -> float:
    return float(np.ptp(project(garment)[:, :2], axis=0).max())


def _shade(
    garment: Garment, fabric: MaterialMaps, faces: np.ndarray, pixels: np.ndarray, view: np.ndarray
) -> np.ndarray:
    image = np.empty((*faces.shape, 3), dtype=np.uint8)
    image[:] = _BACKGROUND
    row, column = np.nonzero(faces)
    face = faces[row, column] - 1
    corners = garment.faces[face]
    weights = _compute_weights(np.stack([column + 0.5, row + 0.5], axis=1), pixels[corners])
    if garment.wall_thickness is None:
        uv = fabric.compute_uvs(garment.rest_vertices)
        place = (uv[corners] * weights[..., None]).sum(axis=1) * len(fabric.base_colour)
        texel = np.floor(place).astype(int) % len(fabric.base_colour)
        colour = fabric.base_colour[texel[:, 1], texel[:, 0]].astype(np.float64)
        light = _light_cloth(garment)[face]
    else:
        colour = fabric.base_colour.mean(axis=(0, 1))
        light = _light_shell(garment, view, face, weights)
    image[row, column] = np.clip(colour * light[:, None], 0, 255).astype(np.uint8)
    return image


def _light_cloth(garment: Garment) -> np.ndarray:
    """Brightness of each face, shape (F,)."""
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
    return np.where(np.isin(garment.face_panels, flaps), light + _FLAP_LIGHT, light)


def _light_shell(
    garment: Garment, view: np.ndarray, face: np.ndarray, weights: np.ndarray
) -> np.ndarray:
    """Brightness of each pixel, shape (N,), smooth over the triangles; inner sides are darker."""
    normals = compute_vertex_normals(view, garment.faces)
    corners = view[garment.faces]
    area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    sign = np.where(area[:, 2] < 0, -1.0, 1.0)[face]
    normal = (normals[garment.faces[face]] * weights[..., None]).sum(axis=1) * sign[:, None]
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    light = 0.58 + 0.5 * np.clip(normal @ (_LIGHT / np.linalg.norm(_LIGHT)), 0, None)
    return np.where(sign < 0, _INSIDE * light, light)


def _compute_weights(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    first, second = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    offset = points - triangles[:, 0]
    area = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]
    area = np.where(np.abs(area) < 1e-9, 1.0, area)
    b1 = (offset[:, 0] * second[:, 1] - offset[:, 1] * second[:, 0]) / area
    b2 = (first[:, 0] * offset[:, 1] - first[:, 1] * offset[:, 0]) / area
    return np.stack([1 - b1 - b2, b1, b2], axis=1)


def _mark_landmarks(
    image: Image.Image, garment: Garment, pixels: np.ndarray, view: np.ndarray
) -> None:
    from PIL import ImageDraw

    pen = ImageDraw.Draw(image)
    radius = max(1.6, image.width / _OVERSAMPLING / 200) * _OVERSAMPLING
    normals = compute_vertex_normals(view, garment.faces)
    for vertex in garment.landmarks.values():
        x, y = pixels[vertex].tolist()
        box = (x - radius, y - radius, x + radius, y + radius)
        if normals[vertex, 2] < -0.1:
            pen.ellipse(box, outline=_MARK, width=_OVERSAMPLING)
        else:
            pen.ellipse(box, fill=_MARK)


def _write_names(image: Image.Image, garment: Garment, pixels: np.ndarray) -> None:
    """Write names outward of their landmarks, moved down where they would cover each other."""
    from PIL import ImageDraw, ImageFont

    pen = ImageDraw.Draw(image)
    font = ImageFont.load_default(size=13 * _OVERSAMPLING)
    gap, taken = 6 * _OVERSAMPLING, []
    for name, vertex in sorted(garment.landmarks.items(), key=lambda item: pixels[item[1], 1]):
        x, y = pixels[vertex].tolist()
        width = pen.textlength(name, font=font)
        left = x + gap if x > image.width / 2 else x - gap - width
        left = min(max(left, 0.0), image.width - width)
        top = y - 8 * _OVERSAMPLING
        height = 15 * _OVERSAMPLING
        for low, high, other in taken:  # these are in order from above
            if low < left + width and left < high and other < top + height and top < other + height:
                top = other + height
        taken.append((left, left + width, top))
        taken.sort(key=lambda entry: entry[2])
        halo = {"stroke_width": 2 * _OVERSAMPLING, "stroke_fill": _BACKGROUND}
        pen.text((left, top), name, fill=_SEAM, font=font, **halo)


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
    strength = _SEAM_STRENGTH[garment.wall_thickness is not None]
    for ends, face in zip(half[is_drawn], owner[is_drawn], strict=True):
        if _is_seen(faces, int(face), centres[face]):
            pen.line(pixels[ends].ravel().tolist(), fill=strength, width=_OVERSAMPLING - 1)
    image.paste(_SEAM, mask=lines)


def _is_seen(faces: np.ndarray, face: int, centre: np.ndarray) -> bool:
    column, row = np.clip(centre.astype(int), 0, faces.shape[0] - 1)
    return bool(faces[row, column] == face + 1)
