"""Pictures of props, and a sheet of them with their names, measures and landmarks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy import ndimage

from dgl_assets.props import Prop
from dgl_physics.drawing.camera import PinholeCamera
from dgl_physics.drawing.light import DAYLIGHT, GAMMA
from dgl_physics.drawing.mesh import Mesh, SurfaceLook
from dgl_physics.drawing.rasteriser import Rasteriser
from dgl_tasks.drawing.bodies import make_part_mesh

__all__ = ["draw_prop", "draw_prop_sheet"]

BACKGROUND = (244, 242, 238)
_FINER = 3  # times that a picture is drawn finer than it becomes
_TEXELS = 512  # of a tile of wood
_LAMPS, _SPREAD = 24, 0.12  # directions to the lamp, and how wide it is [rad]
_SKY = 48  # directions to the sky
_HAZE = 0.03  # of shadows, a share of the light, which is left out: it has streaks and no end
_SHADOW = 192  # of the ground's map of shadows, each way [pixels]

_INK, _SMALL_INK, _MARK = (52, 50, 48), (112, 108, 104), (206, 58, 52)
_CAPTION, _MARGIN = 64, 20


def draw_prop(
    prop: Prop, *, size: tuple[int, int] = (480, 400), azimuth: float = 0.5, elevation: float = 0.32
) -> tuple[np.ndarray, PinholeCamera]:
    """Draw a prop under a lamp and a pale sky, with its shadow on the ground.

    Args:
        prop: What to draw; solid parts fill the picture.
        size: Width and height of the picture [pixels].
        azimuth: Of the viewer, from the front (-y) to the left [rad].
        elevation: Of the viewer above the horizon [rad].

    Returns:
        Picture, shape (H, W, 3), uint8, sRGB, and the camera that projects into it.
    """
    camera = _aim(prop, size, azimuth, elevation)
    fine = replace(camera, width=_FINER * size[0], height=_FINER * size[1])
    meshes = [make_part_mesh(part, texels=_TEXELS, segment=1) for part in prop.parts]
    drawn = Rasteriser(meshes).draw_picture(fine)
    is_prop = (drawn.segments > 0)[..., None]
    blocks = (size[1], _FINER, size[0], _FINER, -1)
    share = is_prop.reshape(blocks).mean(axis=(1, 3))
    light = np.where(is_prop, (drawn.rgb / 255.0) ** GAMMA, 0.0).reshape(blocks).mean(axis=(1, 3))
    image = light + (1.0 - share) * _draw_ground(prop, meshes, camera)
    return (255 * image ** (1 / GAMMA) + 0.5).astype(np.uint8), camera


def _aim(prop: Prop, size: tuple[int, int], azimuth: float, elevation: float) -> PinholeCamera:
    low, high = prop.extent
    right = np.array([np.cos(azimuth), -np.sin(azimuth), 0.0])
    back = np.array([-np.sin(azimuth), -np.cos(azimuth), 0.0])
    towards = np.cos(elevation) * back + [0.0, 0.0, np.sin(elevation)]
    reach = np.abs([right, np.cross(towards, right)]) @ (high - low) / 2
    return PinholeCamera.aim(
        (low + high) / 2,
        towards,
        right,
        distance=4.0 * float(np.linalg.norm(high - low)),
        half_width=float(max(reach[0], reach[1] * size[0] / size[1])) / 0.80,
        size=size,
    )


def _draw_ground(prop: Prop, meshes: list[Mesh], camera: PinholeCamera) -> np.ndarray:
    """Draw the floor and backdrop with the shadow; linear colours, shape (H, W, 3)."""
    low, high = prop.extent
    middle = (low + high)[:2] / 2
    half = 1.2 * float(np.linalg.norm(high - low))
    shadows = ndimage.gaussian_filter(_cast(meshes, middle, half), 1.5, mode="constant")
    rays = camera.compute_rays()
    way = np.where(rays[..., 2] < -1e-3, -camera.position[2] / np.minimum(rays[..., 2], -1e-3), 0.0)
    place = camera.position + way[..., None] * rays
    column, row = ((place[..., k] - middle[k]) / half for k in range(2))
    at = np.stack([0.5 * _SHADOW * (1 - row), 0.5 * _SHADOW * (1 + column)]) - 0.5
    dark = np.where(way > 0, ndimage.map_coordinates(shadows, at, order=1, cval=0.0), 0.0)
    dark = np.maximum(dark - _HAZE, 0.0)[..., None]
    return (np.array(BACKGROUND) / 255.0) ** GAMMA * (1.0 - dark)


def _cast(meshes: list[Mesh], middle: np.ndarray, half: float) -> np.ndarray:
    """Find the share of light that the ground lacks, from above, shape (`_SHADOW`, `_SHADOW`)."""
    two_sided = SurfaceLook(inside_shade=1.0)  # of a flattened mesh, either side is up
    drawn = Rasteriser([replace(mesh, surface=two_sided, body=0) for mesh in meshes])
    above = PinholeCamera.aim(
        [*middle, 0.0],
        [0, 0, 1],
        [1, 0, 0],
        distance=20.0 * half,
        half_width=half,
        size=(_SHADOW, _SHADOW),
    )
    dark = np.zeros((_SHADOW, _SHADOW))
    for direction, weight in _list_lights():
        for k, mesh in enumerate(meshes):
            height = mesh.vertices[:, 2:].astype(np.float64)
            drawn.set_vertices(k, mesh.vertices - height / direction[2] * direction)
        dark += weight * (drawn.find_triangles(above).meshes >= 0)
    return dark


def _list_lights() -> list[tuple[np.ndarray, float]]:
    """Directions to lamp and sky, with the share of each in the light of open level ground."""
    to_lamp = -np.array(DAYLIGHT.direction) / np.linalg.norm(DAYLIGHT.direction)
    lamps = to_lamp + np.random.default_rng(0).normal(0.0, _SPREAD, (_LAMPS, 3))
    height = (np.arange(_SKY) + 0.5) / _SKY
    turn = np.arange(_SKY) * np.pi * (3.0 - np.sqrt(5.0))  # of a sunflower's seeds
    flat = np.sqrt(1 - height**2)
    sky = np.column_stack([flat * np.cos(turn), flat * np.sin(turn), height])
    lamps /= np.linalg.norm(lamps, axis=1, keepdims=True)
    shares = [0.45 * v[:, 2] / v[:, 2].sum() for v in (lamps, sky)]
    return list(zip([*lamps, *sky], np.concatenate(shares).tolist(), strict=True))


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


def _mark(
    pen: object, font: object, prop: Prop, view: PinholeCamera, corner: tuple[int, int]
) -> None:
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
        left = x + 8 if column >= view.width / 2 - 4 else x - 8 - length
        left = min(max(left, corner[0] + 2), corner[0] + view.width - length - 2)
        top = y - 17
        while any(left < b and a < left + length and top < d and c < top + 15
                  for a, b, c, d in taken):  # fmt: skip
            top += 5
        taken.append((left, left + length, top, top + 15))
        pen.text((left, top), text, fill=_MARK, font=font, stroke_width=2, stroke_fill=BACKGROUND)  # pyright: ignore[reportAttributeAccessIssue]
