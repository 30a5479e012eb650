"""Declaration of a task: scene, random draws and success rule, as data.

A demonstration says how the work is done (`dgl_collect.demonstration`); the same declaration serves
collection and evaluation.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Literal

from annotated_types import Ge, Len

from dgl_assets.garments.catalogue import choose_categories
from dgl_assets.props import PropParameters
from dgl_assets.robots import DEFAULT_LEFT_BASE, DEFAULT_RIGHT_BASE, BasePlacement
from dgl_files.fields import adopt_fields
from dgl_physics import ClothMaterial, SolidMaterial
from dgl_physics.drawing.camera import Vector3
from dgl_tasks.cameras import CameraPlacement, Workspace
from dgl_tasks.success import SuccessRule

Range = tuple[float, float]
"""(low, high)."""
Factor = Annotated[float, Ge(0.0)]

SolidTo = Literal["robot", "hands", "garment"]
"""Bodies that collide with an object: the whole robot, its palms and fingers, or the garment alone.

The garment always does.
"""

CAMERAS = ("garment_camera", "environment_camera", "video_camera")
"""Cameras of every task: above the garment, for policies, and for people."""
RESERVED_NAMES = ("garment", "now", "ground")
"""Names that no object may have: formulas and the scene use them for other things."""


@dataclass(frozen=True, kw_only=True)
class SceneObject:
    """An object in the scene: its kind, its pose, and the random part of the pose."""

    name: str
    """Name in the scene, in `GarmentEnv.objects`, in formulas and in the episode's draws."""
    prop: str | PropParameters | Annotated[tuple[str | PropParameters, ...], Len(1, 1000)]
    """Kind of `dgl_assets.props`, or parameters of one. Of several, one is drawn for each episode;
    their landmarks have the same names."""
    position: Vector3
    """Nominal position of the object's origin [m], world frame; most stand on z = 0."""
    yaw: float = 0.0
    """Rotation about z [rad]."""
    x_range: Range = (0.0, 0.0)
    """Random offset in x [m]."""
    y_range: Range = (0.0, 0.0)
    """Random offset in y [m]."""
    yaw_range: Range = (0.0, 0.0)
    """Random turn about z, beyond `yaw` [rad]."""
    friction: Factor = 0.5
    """Factor on the garment's friction."""
    solid_to: SolidTo = "robot"
    avoided: bool = False
    """Ways of arms and hands through it count as out of reach, and touches are measured."""

    def __post_init__(self) -> None:
        adopt_fields(self)
        if not self.name.isidentifier() or self.name in RESERVED_NAMES:
            raise ValueError(
                f"name of an object must be an identifier other than {', '.join(RESERVED_NAMES)}; "
                f"got {self.name!r}"
            )
        _check_ranges(self, "x_range", "y_range", "yaw_range")

    @property
    def props(self) -> tuple[str | PropParameters, ...]:
        """The props of which one is drawn."""
        return self.prop if isinstance(self.prop, tuple) else (self.prop,)


@dataclass(frozen=True, kw_only=True)
class HandFriction:
    """Friction of the hands' pads: factors on the material's friction (25 in the original code)."""

    fingers: Factor = 3.0
    """Palm and fingers. At 1, hems and the corners of crumpled garments slip out; a fling by the
    shoulders needs more than a fold."""
    thumb: Factor | None = None
    """Thumb, inside a garment over a bar as the hand retreats; as `fingers` when None."""

    def __post_init__(self) -> None:
        adopt_fields(self)


@dataclass(frozen=True, kw_only=True)
class Start:
    """Initial placement of the garment: it falls from a height and settles."""

    on: str | None = None
    """Frame of an object that the garment is put on, such as "stand.top"; the ground when None."""
    x_range: Range = (0.0, 0.0)
    """Garment's centre in x [m], from `on`."""
    y_range: Range = (0.0, 0.0)
    """Garment's centre in y [m], from `on`."""
    yaw: float = 0.0
    """Rotation of the garment about z [rad]."""
    roll_range: Range = (0.0, 0.0)
    """Rotation about x before the yaw [rad]: the slope of the garment when it is dropped."""
    height: Factor = 0.2
    """Height of the garment's lowest point when it is dropped [m], from `on`."""
    level: str | None = None
    """Landmark of the garment that is at the height instead of the lowest point."""
    settle_frames: Annotated[int, Ge(0)] = 60
    """Frames of 1/60 s from the drop to the end of a reset."""
    value_below: float | None = None
    """Upper limit of the rule's value at the start. A garment that has fallen flatter is dropped
    again, 5 degrees steeper each time: lifting and dropping it must not succeed. None for any."""

    def __post_init__(self) -> None:
        adopt_fields(self)
        _check_ranges(self, "x_range", "y_range", "roll_range")


@dataclass(frozen=True, kw_only=True)
class Task:
    """A garment-manipulation task."""

    id: str
    """Environment id, such as "FoldTops-v1"."""
    title: str
    category: str
    """Garment category in `dgl_assets`."""
    measures: Mapping[str, str | Range] = field(default_factory=dict)
    """Of the garments that are drawn: words, and limits of numbers, by the name of the measure,
    such as {"hand": "right", "cuff_length": (0.05, 0.15)}."""
    description: str
    success_text: str
    """The success rule in words."""
    start: Start
    success: SuccessRule
    objects: tuple[SceneObject, ...] = ()
    """Objects in the scene besides robots and garment."""
    left_base: BasePlacement = DEFAULT_LEFT_BASE
    right_base: BasePlacement = DEFAULT_RIGHT_BASE
    cameras: Mapping[str, CameraPlacement]
    """By the names `CAMERAS`; `dgl_tasks.layouts` has some."""
    picture_camera: str = "garment_camera"
    """Camera of the picture at the end of an episode."""
    workspace: Workspace = field(default_factory=Workspace)
    material: ClothMaterial | SolidMaterial = field(default_factory=ClothMaterial)
    """Of the garment: cloth, or the wall of an elastic shell."""
    stiffness: Mapping[str, float] = field(default_factory=dict)
    """Factor on a cloth's flexural rigidity or a solid's Young's modulus by panel of the garment,
    where it is not 1."""
    shrinkage: Mapping[str, float] = field(default_factory=dict)
    """Factor on the rest lengths of a cloth by panel, where it is not 1, as of an elastic band."""
    hand_friction: HandFriction = field(default_factory=HandFriction)
    rim_grip: Annotated[float, Ge(0.0)] | None = None
    """Help that no robot has: to a hand that is more than half closed sticks the edge of an opening
    that was within this distance of its grasp point [m], up to this length to either side of the
    nearest vertex. None for contact alone."""
    ground_friction: float = 0.5
    """Friction of the ground (original code), a factor on the material's."""

    def __post_init__(self) -> None:
        if isinstance(self.success, type):
            name = self.success.__name__
            raise ValueError(f"success must be a rule, such as {name}(...); got the class {name}")
        adopt_fields(self)
        choose_categories([self.category])
        if set(self.cameras) != set(CAMERAS) or self.picture_camera not in CAMERAS:
            raise ValueError(
                f"cameras must be {', '.join(CAMERAS)}, and picture_camera one of them; "
                f"got {sorted(self.cameras)} and {self.picture_camera!r}"
            )
        names = [item.name for item in self.objects]
        if len(set(names)) < len(names):
            raise ValueError(f"objects must have different names; got {names}")


def _check_ranges(declared: object, *names: str) -> None:
    for name in names:
        low, high = getattr(declared, name)
        if low > high:
            raise ValueError(f"{name} must be (low, high) with low <= high; got {(low, high)}")
