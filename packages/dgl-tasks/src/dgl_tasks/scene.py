"""The studio that tasks take place in: a calm floor with a work mat, soft light, a plain backdrop.

Everything is picture only, except for the ground plane. Light is one lamp and a dome; both are
cheap to draw on a processor, and so are the flat shadows of `dgl_tasks.shadows`.
"""

import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import imageio.v3 as iio
import numpy as np
import sapien

from dgl_tasks.shadows import CORNERS, FloorShadow

if TYPE_CHECKING:
    from mani_skill.envs.scene import ManiSkillScene
    from mani_skill.utils.structs import Actor

Point2 = tuple[float, float]
Point3 = tuple[float, float, float]

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
KEY_DIRECTION = (0.52, -0.27, -0.81)
"""Where the lamp's light goes: in from the side, so that folds show."""
KEY_COLOUR = (2.75, 2.68, 2.55)
"""Light of the lamp; a white floor under it shines with this, times the sine of its height, over pi."""

SHADE = 0.62
"""Brightness of the floor in shadow, linear, a factor: lighter than true, as under a large lamp."""

_COLUMN = 0.15  # width of the robots' columns [m]
_NEAR_SIDE, _FAR_SIDE = 6.0, 60.0  # the detailed middle of the floor and all of it [m]
_EDGE = 0.006  # width of a drawn edge [m]


def build_floor(
    scene: "ManiSkillScene", *, mat_centre: Point2, pedestals: Sequence[Point2] = ()
) -> "Actor":
    """Add the ground: a collision plane at z = 0 and, where pictures are taken, its look.

    Args:
        scene: ManiSkill's scene; with `render_backend="none"` nothing is drawn.
        mat_centre: Centre of the work mat [m], world frame.
        pedestals: Where robots stand [m]; the floor is darker around them, as it would be.
    """
    builder = scene.create_actor_builder()
    # SAPIEN's planes face along x
    builder.add_plane_collision(sapien.Pose(q=[np.sqrt(0.5), 0, -np.sqrt(0.5), 0]))
    builder.initial_pose = sapien.Pose()  # pyright: ignore[reportAttributeAccessIssue]
    ground = builder.build_static(name="ground")
    if scene.can_render():
        for side, hole, pixels in ((_NEAR_SIDE, 0.0, 1024), (_FAR_SIDE, _NEAR_SIDE, 512)):
            image = paint_floor(side, pixels, mat_centre=mat_centre, pedestals=pedestals)
            shape = _make_square(side, hole, mat_centre, image)
            for entity in ground._objs:  # noqa: SLF001  ManiSkill has no way to add a mesh
                component = sapien.render.RenderBodyComponent()
                component.attach(shape)
                entity.add_component(component)
    return ground


def build_shadow(
    scene: "ManiSkillScene",
    bodies: Sequence[sapien.physx.PhysxRigidBaseComponent],
    *,
    mat_centre: Point2,
    pedestals: Sequence[Point3] = (),
) -> FloorShadow:
    """Add the shadow that garment, bodies and pedestals throw onto the floor of `build_floor`.

    Args:
        scene: ManiSkill's scene, which must be able to render.
        bodies: Rigid bodies that throw shadows.
        mat_centre: Centre of the work mat [m].
        pedestals: Upper ends of the robots' columns [m].
    """
    feet = [base[:2] for base in pedestals]
    image = paint_floor(_NEAR_SIDE, 1024, mat_centre=mat_centre, pedestals=feet)
    shaded = (image * SHADE ** (1 / 2.2)).astype(np.uint8)  # sRGB is close to a power law
    columns = [
        np.array([x, y, z / 2]) + CORNERS * [_COLUMN / 2, _COLUMN / 2, z / 2]
        for x, y, z in pedestals
    ]
    return FloorShadow(
        scene.sub_scenes[0],
        bodies,
        direction=KEY_DIRECTION,
        material=_make_matt(shaded),
        picture_centre=mat_centre,
        picture_side=_NEAR_SIDE,
        fixed=columns,
    )


def light_scene(scene: "ManiSkillScene") -> None:
    """Add the lamp and the dome, which is also the backdrop."""
    scene.set_ambient_light([0.0, 0.0, 0.0])
    scene.add_directional_light(list(KEY_DIRECTION), list(KEY_COLOUR), shadow=False)
    cubemap = _make_dome()
    for sub_scene in scene.sub_scenes:
        sub_scene.set_environment_map(cubemap)


def paint_floor(
    side: float, pixels: int, *, mat_centre: Point2, pedestals: Sequence[Point2] = ()
) -> np.ndarray:
    """Paint a square of floor around the mat.

    Args:
        side: Length of the square's sides [m].
        pixels: Pixels along a side.
        mat_centre: Centre of the mat and of the square [m].
        pedestals: Where robots stand [m].

    Returns:
        Picture, shape (pixels, pixels, 3), uint8, sRGB; rows follow world y, columns world x.
    """
    offset = ((np.arange(pixels) + 0.5) / pixels - 0.5) * side
    x, y = np.meshgrid(offset, offset)  # from the mat's centre
    soft = max(_EDGE, side / pixels)
    colour = np.broadcast_to(np.array(FLOOR), (pixels, pixels, 3))

    depth = _depth_in_rounded_box(x, y, MAT_SIZE, radius=0.07)
    is_mat = _ramp(depth, -soft / 2, soft / 2)
    is_rim = is_mat * (1.0 - _ramp(np.abs(depth - 0.035), 0.0015, 0.0015 + soft))
    shadow = 0.88 + 0.12 * _ramp(-depth, -0.01, 0.05)
    colour = colour * shadow[..., None]
    colour = _mix(colour, np.array(MAT), is_mat)
    colour = _mix(colour, np.array(FLOOR), 0.55 * is_rim)
    for px, py in pedestals:
        distance = np.hypot(x - (px - mat_centre[0]), y - (py - mat_centre[1]))
        colour = colour * (1.0 - 0.55 * np.exp(-((distance / 0.26) ** 2)))[..., None]

    # A studio's floor runs into the backdrop. What the dome shows there is seen as it is; the floor
    # shows its colour times the light that falls on it.
    is_backdrop = _ramp(np.hypot(x, y), 2.2, 9.0)
    colour = _mix(colour, np.array(HORIZON) / light_on_floor(), is_backdrop)
    return np.clip(255 * np.clip(colour, 0, 1) ** (1 / 2.2) + 0.5, 0, 255).astype(np.uint8)


def light_on_floor() -> np.ndarray:
    """What a white floor shines with, linear, shape (3,)."""
    direction = np.array(KEY_DIRECTION)
    sine = -direction[2] / np.linalg.norm(direction)
    dome = 0.8 * np.array(ZENITH) + 0.2 * np.array(HORIZON)  # the blur of SAPIEN's diffuse light
    return np.array(KEY_COLOUR) * sine / np.pi + dome


def _make_square(
    side: float, hole: float, centre: Point2, image: np.ndarray
) -> sapien.render.RenderShapeTriangleMesh:
    """Make a horizontal square at z = 0, or a frame around a square hole, with a picture on it."""
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) / 2.0
    if hole:
        flat = np.concatenate([corners * side, corners * hole])
        i = np.arange(4)
        j = (i + 1) % 4
        triangles = np.concatenate([np.stack([i, j, 4 + j], 1), np.stack([i, 4 + j, 4 + i], 1)])
    else:
        flat, triangles = corners * side, np.array([[0, 1, 2], [0, 2, 3]])
    vertices = np.column_stack([flat + centre, np.zeros(len(flat))])
    return sapien.render.RenderShapeTriangleMesh(
        vertices=vertices.astype(np.float32),
        triangles=triangles.astype(np.uint32),
        normals=np.tile(np.array([0, 0, 1], dtype=np.float32), (len(vertices), 1)),
        uvs=(flat / side + 0.5).astype(np.float32),
        material=_make_matt(image),
    )


def _make_matt(image: np.ndarray) -> sapien.render.RenderMaterial:
    material = sapien.render.RenderMaterial()
    material.roughness = 1.0
    material.specular = 0.0
    opaque = np.full((*image.shape[:2], 1), 255, dtype=np.uint8)
    material.base_color_texture = sapien.render.RenderTexture2D(
        np.concatenate([image, opaque], axis=2),
        "R8G8B8A8Unorm",
        mipmap_levels=int(np.log2(len(image))),
        address_mode="edge",
        srgb=True,
    )
    return material


def _make_dome(pixels: int = 256) -> sapien.render.RenderCubemap:
    """Make the environment map: light by height, the same all around."""
    ramp = (np.arange(pixels) + 0.5) / pixels * 2 - 1
    across, down = np.meshgrid(ramp, ramp)
    side = -down / np.sqrt(1 + across**2 + down**2)  # sine of the height, first row uppermost
    top = 1 / np.sqrt(1 + across**2 + down**2)
    with tempfile.TemporaryDirectory() as folder:  # SAPIEN reads cube maps from files only
        paths = []
        for name, sine in (("side", side), ("top", top), ("bottom", -top)):
            paths.append(str(Path(folder) / f"{name}.png"))
            colour = _mix(np.array(HORIZON), np.array(ZENITH), _ramp(sine, 0.1, 0.9))
            colour = _mix(colour, np.array(NADIR), _ramp(-sine, 0.0, 0.7))
            iio.imwrite(paths[-1], (255 * colour ** (1 / 2.2) + 0.5).astype(np.uint8))
        around, above, below = paths
        cubemap = sapien.render.RenderCubemap(around, around, above, below, around, around)
        cubemap.export(str(Path(folder) / "dome.ktx"))  # reads the files now, not at first use
    return cubemap


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
