"""The studio that tasks take place in: a calm floor with a work mat, soft light, a plain backdrop.

Everything is picture only, except for the ground plane; `Appearance` shows it. Light is one lamp
and a dome; both are cheap to draw on a processor, and so are the flat shadows of
`dgl_tasks.shadows`.
"""

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import sapien

from dgl_assets.materials import (
    PALE,
    WEAVES,
    YARNS,
    FabricMaterial,
    FloorMaterial,
    Weave,
    sample_fabric_material,
    sample_floor_material,
)
from dgl_physics.drawing.light import Studio
from dgl_physics.drawing.mesh import Image, Mesh, SurfaceLook

if TYPE_CHECKING:
    from mani_skill.envs.scene import ManiSkillScene
    from mani_skill.utils.structs import Actor

Point2 = tuple[float, float]

FLOOR = (0.585, 0.560, 0.525)
"""Colour of the floor, linear."""
MAT = (0.165, 0.225, 0.275)
"""Colour of the work mat, linear."""
MAT_SIZE = (2.0, 1.36)
"""Width and depth of the mat [m]."""
ZENITH = (0.20, 0.21, 0.23)
"""Light of the dome from above, linear."""
HORIZON = (0.50, 0.49, 0.475)
"""Light of the dome from the sides and colour of the backdrop, linear."""
NADIR = (0.13, 0.12, 0.11)
"""Light that the floor throws back, linear."""
DOME_PATH = Path(__file__).with_name("dome.ktx")
"""The dome of these three colours as a cube map; `scripts/make_dome.py` writes it."""
KEY_DIRECTION = (0.52, -0.27, -0.81)
"""Direction of the lamp's light: from the side, so that folds show."""
KEY_COLOUR = (2.75, 2.68, 2.55)
"""Light of the lamp; a white floor reflects this, times the sine of its height, over pi."""

SHADE = 0.62
"""Brightness of the floor in shadow, linear, a factor: lighter than true, as under a large lamp."""

_STUDIO_AVOIDED = (
    *PALE,
    "navy",
    "denim",
    "sky",
    "charcoal",
    "black",
    "olive",
    "camel",
    "chocolate",
    "sage",
)
"""Yarns that are too near the colours of floor or mat."""
_STUDIO_WEAVES: tuple[Weave, ...] = tuple(w for w in WEAVES if w != "denim")

_NEAR_SIDE, _FAR_SIDE = 6.0, 60.0  # the detailed middle of the floor and all of it [m]
_EDGE = 0.006  # width of a drawn edge [m]
_NEAR_PIXEL = _NEAR_SIDE / 1024  # of the detailed middle [m]
_FINEST = 0.02  # pixels above this size show no grain of a floor [m]


@dataclass(frozen=True, kw_only=True)
class FloorLook:
    """Look of floor and mat."""

    material: FloorMaterial | None = None
    """Material of the floor; the studio's plain floor when None."""
    turn: float = 0.0
    """Angle between the material's u and the world's x [rad]."""
    offset: Point2 = (0.0, 0.0)
    """Origin of the material's tile [m]."""
    mat: tuple[float, float, float] | None = MAT
    """Colour of the mat, linear; without a mat when None."""


STUDIO = FloorLook()
"""A plain floor with a work mat."""


def sample_studio_fabric(seed: int | Sequence[int] | np.random.Generator) -> FabricMaterial:
    """Draw a fabric that is easily told from the studio's floor and mat."""
    return sample_fabric_material(seed, weaves=_STUDIO_WEAVES, avoid=_STUDIO_AVOIDED)


def sample_floor_look(seed: int | Sequence[int] | np.random.Generator) -> FloorLook:
    """Draw a floor, how it lies, and a mat of some colour or none."""
    rng = np.random.default_rng(seed)
    material = sample_floor_material(rng)
    x, y = rng.uniform(0.0, material.tile_size, 2)
    colours = list(YARNS.values())
    colour = colours[rng.integers(len(colours))]
    r, g, b = (float((c / 255.0) ** 2.2) for c in colour)
    return FloorLook(
        material=material,
        turn=float(rng.uniform(0.0, 2 * np.pi)),
        offset=(float(x), float(y)),
        mat=(r, g, b) if rng.random() < 0.5 else None,
    )


def build_floor(scene: "ManiSkillScene") -> "Actor":
    """Add the ground, a collision plane at z = 0, without a look."""
    builder = scene.create_actor_builder()
    # SAPIEN's planes face along x
    builder.add_plane_collision(sapien.Pose(q=[np.sqrt(0.5), 0, -np.sqrt(0.5), 0]))
    builder.initial_pose = sapien.Pose()  # pyright: ignore[reportAttributeAccessIssue]
    return builder.build_static(name="ground")


def make_floor(
    look: FloorLook, *, mat_centre: Point2, pedestals: Sequence[Point2] = ()
) -> tuple[Mesh, Mesh]:
    """Make meshes of the floor, world frame: its detailed middle and a frame of the rest.

    Args:
        look: Of floor and mat.
        mat_centre: Centre of the work mat [m].
        pedestals: Feet of the robots' columns [m]; the floor is darker around them.
    """
    near, far = (
        _make_matt(
            paint_floor(side, pixels, mat_centre=mat_centre, pedestals=tuple(pedestals), look=look)
        )
        for side, pixels in ((_NEAR_SIDE, 1024), (_FAR_SIDE, 512))
    )
    square = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) / 2.0
    inner, outer = (side * square + mat_centre for side in (_NEAR_SIDE, _FAR_SIDE))
    sides = [(i, (i + 1) % 4) for i in range(4)]
    frame = [[i, j, j + 4] for i, j in sides] + [[i, j + 4, i + 4] for i, j in sides]
    return (
        make_flat(inner, np.array([[0, 1, 2], [0, 2, 3]]), near, mat_centre),
        make_flat(np.concatenate([outer, inner]), np.array(frame), far, mat_centre, side=_FAR_SIDE),
    )


def make_shade(look: SurfaceLook) -> SurfaceLook:
    """Make the look in shadow of a part of the floor."""
    assert look.image is not None
    # sRGB is close to a power law
    return _make_matt((look.image.pixels * SHADE ** (1 / 2.2)).astype(np.uint8))


def make_flat(
    vertices: np.ndarray,
    faces: np.ndarray,
    look: SurfaceLook,
    mat_centre: Point2,
    *,
    side: float = _NEAR_SIDE,
    height: float = 0.0,
) -> Mesh:
    """Make a level mesh with the floor's picture.

    Args:
        vertices: [m], shape (V, 2), world frame.
        faces: Triangles, shape (F, 3).
        look: Of the detailed middle, unless `side` says otherwise.
        mat_centre: Centre of the picture [m].
        side: Length of the picture's sides [m].
        height: Above the ground [m].
    """
    return Mesh(
        vertices=np.column_stack([vertices, np.full(len(vertices), height)]),
        normals=np.tile([0.0, 0.0, 1.0], (len(vertices), 1)),
        faces=faces,
        uvs=(vertices - mat_centre) / side + 0.5,
        surface=look,
        segment=0,
    )


def _make_matt(picture: np.ndarray) -> SurfaceLook:
    return SurfaceLook(image=Image(pixels=picture, is_repeated=False))


def light_scene(scene: "ManiSkillScene") -> None:
    """Add the lamp and the dome, which is also the backdrop."""
    scene.set_ambient_light([0.0, 0.0, 0.0])
    scene.add_directional_light(list(KEY_DIRECTION), list(KEY_COLOUR), shadow=False)
    for sub_scene in scene.sub_scenes:
        sub_scene.set_environment_map(_load_dome())


@functools.cache  # one for all scenes, which also keeps SAPIEN's renderer between them
def _load_dome() -> sapien.render.RenderCubemap:
    return sapien.render.RenderCubemap(str(DOME_PATH))


def shine_dome(sine: np.ndarray) -> np.ndarray:
    """Light of the dome by the sine of the height, of any shape; linear, shape (..., 3)."""
    colour = _mix(np.array(HORIZON), np.array(ZENITH), _ramp(sine, 0.1, 0.9))
    return _mix(colour, np.array(NADIR), _ramp(-sine, 0.0, 0.7))


LIGHT = Studio(direction=KEY_DIRECTION, colour=KEY_COLOUR, dome=shine_dome, shade=SHADE)
"""The studio's lamp and dome."""


@functools.lru_cache(maxsize=4)  # two are the studio, which every scene begins with
def paint_floor(
    side: float,
    pixels: int,
    *,
    mat_centre: Point2,
    pedestals: tuple[Point2, ...] = (),
    look: FloorLook = STUDIO,
) -> np.ndarray:
    """Paint a square of floor around the mat.

    Args:
        side: Length of the square's sides [m].
        pixels: Pixels along a side.
        mat_centre: Centre of the mat and of the square [m].
        pedestals: Where robots stand [m].
        look: Of floor and mat.

    Returns:
        Read-only picture, shape (pixels, pixels, 3), uint8, sRGB; rows follow y, columns x.
    """
    offset = ((np.arange(pixels) + 0.5) / pixels - 0.5) * side
    x, y = np.meshgrid(offset, offset)  # from the mat's centre
    soft = max(_EDGE, side / pixels)
    colour = np.broadcast_to(np.array(FLOOR), (pixels, pixels, 3))
    if look.material is not None:
        colour = _lay(look.material, look, x, y, pixel=side / pixels)

    depth = _depth_in_rounded_box(x, y, MAT_SIZE, radius=0.07)
    if look.mat is not None:
        is_mat = _ramp(depth, -soft / 2, soft / 2)
        is_rim = is_mat * (1.0 - _ramp(np.abs(depth - 0.035), 0.0015, 0.0015 + soft))
        shadow = 0.88 + 0.12 * _ramp(-depth, -0.01, 0.05)
        colour = colour * shadow[..., None]
        colour = _mix(colour, np.array(look.mat), is_mat)
        colour = _mix(colour, np.array(FLOOR), 0.55 * is_rim)
    for px, py in pedestals:
        distance = np.hypot(x - (px - mat_centre[0]), y - (py - mat_centre[1]))
        colour = colour * (1.0 - 0.55 * np.exp(-((distance / 0.26) ** 2)))[..., None]

    # A studio's floor runs into the backdrop. What the dome shows there is seen as it is; the floor
    # shows its colour times the light that falls on it.
    is_backdrop = _ramp(np.hypot(x, y), 2.2, 9.0)
    colour = _mix(colour, np.array(HORIZON) / light_on_floor(), is_backdrop)
    picture = np.clip(255 * np.clip(colour, 0, 1) ** (1 / 2.2) + 0.5, 0, 255).astype(np.uint8)
    picture.setflags(write=False)  # it is kept for the next scene
    return picture


def _lay(
    material: FloorMaterial, look: FloorLook, x: np.ndarray, y: np.ndarray, *, pixel: float
) -> np.ndarray:
    """Lay a material on the floor, linear, shape (..., 3); its mean where pixels are too large."""
    # Texels as large as the picture's pixels: finer ones would make patterns of their own.
    maps = material.render(int(np.clip(material.tile_size / _NEAR_PIXEL, 64, 1024)))
    mean = np.array(maps.mean_colour)
    if pixel > _FINEST:
        return np.broadcast_to(mean, (*x.shape, 3))
    c, s = np.cos(look.turn), np.sin(look.turn)
    u, v = c * x + s * y + look.offset[0], c * y - s * x + look.offset[1]
    colour = (maps.sample_colour(u, v) / 255.0) ** 2.2
    # The detailed middle of the floor ends here, and meets the rest of it.
    return _mix(colour, mean, _ramp(np.hypot(x, y), 0.8 * _NEAR_SIDE / 2, _NEAR_SIDE / 2))


def light_on_floor() -> np.ndarray:
    """Light that a white floor reflects, linear, shape (3,)."""
    direction = np.array(KEY_DIRECTION)
    sine = -direction[2] / np.linalg.norm(direction)
    dome = 0.8 * np.array(ZENITH) + 0.2 * np.array(HORIZON)  # the blur of SAPIEN's diffuse light
    return np.array(KEY_COLOUR) * sine / np.pi + dome


def _depth_in_rounded_box(
    x: np.ndarray, y: np.ndarray, size: tuple[float, float], *, radius: float
) -> np.ndarray:
    """Distance to the edge of a rounded rectangle about the origin, positive inside [m]."""
    dx, dy = np.abs(x) - size[0] / 2 + radius, np.abs(y) - size[1] / 2 + radius
    outside = np.hypot(np.maximum(dx, 0), np.maximum(dy, 0))
    return radius - outside - np.minimum(np.maximum(dx, dy), 0)


def _ramp(value: np.ndarray, low: float, high: float) -> np.ndarray:
    """Rise smoothly from 0 at `low` to 1 at `high`."""
    t = np.clip((value - low) / (high - low), 0.0, 1.0)
    return t * t * (3 - 2 * t)


def _mix(first: np.ndarray, second: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Blend colours, shape (..., 3), by the second's share, shape (H, W)."""
    return first + (second - first) * share[..., None]
