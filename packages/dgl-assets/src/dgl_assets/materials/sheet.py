"""A sheet of swatches: fabrics with cut edges and soft folds, floors as sample boards."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from dgl_assets.materials.fabric import FabricMaterial, sample_fabric_material
from dgl_assets.materials.floor import FloorMaterial, sample_floor_material
from dgl_assets.materials.maps import GAMMA, MaterialMaps

if TYPE_CHECKING:
    from PIL import Image

_BACKGROUND = (244, 242, 238)
_INK, _TITLE_INK = (96, 92, 88), (52, 50, 48)
_LIGHT = np.array([-0.48, -0.58, 0.66]) / np.linalg.norm([-0.48, -0.58, 0.66])
"""Direction to the lamp: x right, y down, z to the viewer."""
_GAP, _CAPTION, _MARGIN, _HEADING = 26, 30, 44, 54
_CUT = 0.021  # depth of the pinked edge, a share of the swatch
_OVERSAMPLING = 2
_FABRIC_WIDTH, _FLOOR_WIDTH = 0.17, 1.7  # of a swatch [m]


def draw_material_sheet(
    seed: int, *, fabrics: int = 18, floors: int = 12, columns: int = 6, size: int = 220
) -> np.ndarray:
    """Draw fabrics and floors of a seed beside each other.

    Args:
        seed: Seed of the sheet; its k-th fabric has the seed [seed, 0, k], its k-th floor
            [seed, 1, k].
        fabrics: Number of fabrics.
        floors: Number of floors.
        columns: Swatches in a row.
        size: Side of a swatch [pixels].

    Returns:
        Picture, shape (H, W, 3), uint8, sRGB.
    """
    if fabrics < 0 or floors < 0 or fabrics + floors < 1 or columns < 1 or size < 64:
        raise ValueError(
            "expected at least one swatch, one column and 64 pixels; got "
            f"{fabrics} fabrics, {floors} floors, {columns} columns and {size} pixels"
        )
    drawn = sample_materials(seed, fabrics=fabrics, floors=floors)
    groups = list(zip(("Fabrics", "Floors"), drawn, strict=True))
    return _compose([group for group in groups if group[1]], columns, size, seed)


def sample_materials(
    seed: int, *, fabrics: int, floors: int
) -> tuple[list[FabricMaterial], list[FloorMaterial]]:
    """Draw the materials of a sheet: the k-th from the seeds [seed, 0, k] and [seed, 1, k]."""
    return (
        [sample_fabric_material([seed, 0, k]) for k in range(fabrics)],
        [sample_floor_material([seed, 1, k]) for k in range(floors)],
    )


def _compose(
    groups: Sequence[tuple[str, Sequence[FabricMaterial | FloorMaterial]]],
    columns: int,
    size: int,
    seed: int,
) -> np.ndarray:
    from PIL import Image, ImageDraw, ImageFont

    pitch = size + _GAP
    rows = [-(-len(materials) // columns) for _, materials in groups]
    width = 2 * _MARGIN + columns * pitch - _GAP
    height = 2 * _MARGIN - _CAPTION + sum(_HEADING + n * (pitch + _CAPTION) for n in rows)
    page = Image.new("RGB", (width, height), _BACKGROUND)
    pen = ImageDraw.Draw(page)
    title, small = ImageFont.load_default(size=26), ImageFont.load_default(size=13)
    top = _MARGIN
    rng = np.random.default_rng([seed, 2])
    for (heading, materials), count in zip(groups, rows, strict=True):
        pen.text((_MARGIN, top), heading, fill=_TITLE_INK, font=title)
        top += _HEADING
        for index, material in enumerate(materials):
            row, column = divmod(index, columns)
            x, y = _MARGIN + column * pitch, top + row * (pitch + _CAPTION)
            swatch, mask = _draw_swatch(material, size, rng)
            _paste_with_shadow(page, swatch, mask, (x, y))
            text = _fit(material.name, pen, small, size)
            pen.text((x + 2, y + size + 8), text, fill=_INK, font=small)
        top += count * (pitch + _CAPTION)
    return np.array(page)


def _draw_swatch(
    material: FabricMaterial | FloorMaterial, size: int, rng: np.random.Generator
) -> tuple[Image.Image, Image.Image]:
    """Draw one swatch and the mask of its outline, at the final size."""
    from PIL import Image

    is_cloth = isinstance(material, FabricMaterial)
    maps = material.render(512 if is_cloth else 1024)
    side = size * _OVERSAMPLING
    x, y = np.meshgrid(*[(np.arange(side) + 0.5) / side] * 2)
    metres = _FABRIC_WIDTH if is_cloth else min(_FLOOR_WIDTH, maps.tile_size)
    slope = _fold(x, y, rng) if is_cloth else np.zeros((side, side, 2))
    image = _light(maps, x * metres, y * metres, slope)
    outline = _pink(x, y) if is_cloth else _round(x, y)
    shape, filter_ = (size, size), Image.Resampling.BOX
    return (
        Image.fromarray(image).resize(shape, filter_),
        Image.fromarray((255 * outline).astype(np.uint8)).resize(shape, filter_),
    )


def _light(maps: MaterialMaps, x: np.ndarray, y: np.ndarray, slope: np.ndarray) -> np.ndarray:
    """Shade a flat piece of a material whose surface is inclined by `slope`, shape (N, N, 2)."""
    size = len(maps.base_colour)
    row = np.floor(y / maps.tile_size * size).astype(int) % size
    column = np.floor(x / maps.tile_size * size).astype(int) % size
    normal = maps.normal[row, column] / 127.5 - 1.0
    normal[..., :2] -= slope
    normal /= np.linalg.norm(normal, axis=2, keepdims=True)
    colour = (maps.sample_colour(x, y) / 255.0) ** GAMMA
    roughness = maps.roughness[row, column] / 255.0
    diffuse = 0.33 + 0.9 * np.clip(normal @ _LIGHT, 0.0, 1.0)
    half = _LIGHT + np.array([0.0, 0.0, 1.0])
    toward = np.clip(normal @ (half / np.linalg.norm(half)), 0.0, 1.0)
    power = 2.0 / np.maximum(roughness, 0.15) ** 4
    shine = 0.012 * (power + 2.0) / 8.0 * toward**power
    linear = colour * diffuse[..., None] + shine[..., None]
    return (255 * np.clip(linear, 0.0, 1.0) ** (1 / GAMMA) + 0.5).astype(np.uint8)


def _fold(x: np.ndarray, y: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Slope of a cloth that lies with a few soft waves, shape (N, N, 2)."""
    slope = np.zeros((*x.shape, 2))
    for _ in range(3):
        angle, length = rng.uniform(0.2, 1.2), rng.uniform(0.35, 0.9)
        across = np.array([np.cos(angle), np.sin(angle)])
        phase = 2 * np.pi * ((x * across[0] + y * across[1]) / length + rng.random())
        slope += 0.13 * np.sin(phase)[..., None] * across
    return slope


def _pink(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Outline of cloth that was cut with pinking shears."""
    teeth = 26
    along = [np.abs(p * teeth % 1.0 - 0.5) * 2 * _CUT for p in (x, y)]
    nearest = [np.minimum(p, 1 - p) for p in (x, y)]
    return (nearest[0] > along[1]) & (nearest[1] > along[0])


def _round(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Outline of a board with rounded corners."""
    radius = 0.035
    dx, dy = (np.maximum(np.abs(p - 0.5) - 0.5 + radius, 0.0) for p in (x, y))
    return np.hypot(dx, dy) <= radius


def _paste_with_shadow(
    page: Image.Image, swatch: Image.Image, mask: Image.Image, place: tuple[int, int]
) -> None:
    from PIL import Image, ImageFilter

    border = 24
    wide = Image.new("L", (swatch.width + 2 * border, swatch.height + 2 * border), 0)
    wide.paste(mask.point(lambda value: int(0.42 * value)), (border + 3, border + 5))
    soft = wide.filter(ImageFilter.GaussianBlur(6))
    page.paste((60, 54, 48), (place[0] - border, place[1] - border), soft)
    page.paste(swatch, place, mask)


def _fit(text: str, pen: object, font: object, width: int) -> str:
    """Cut a text that is wider than a swatch."""
    while pen.textlength(text, font=font) > width:  # pyright: ignore[reportAttributeAccessIssue]
        text = text.rstrip("…")[:-1] + "…"
    return text
