"""What a task is: data. The machinery that runs it is shared by all tasks.

A declaration says what is in the scene, what is drawn at random, and what counts as success. How the work is done is a
demonstration's to say (`dgl_collect.demonstration`); the same declaration serves collection and evaluation.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

from dgl_assets.props import PropParameters
from dgl_assets.robots import DEFAULT_LEFT_BASE, DEFAULT_RIGHT_BASE, BasePlacement
from dgl_physics import ClothMaterial
from dgl_tasks.cameras import CameraPlacement, Workspace
from dgl_tasks.success import SuccessRule

Range = tuple[float, float]
Vector3 = tuple[float, float, float]


@dataclass(frozen=True, kw_only=True)
class SceneObject:
    """A thing in the scene besides robots and garment: what it is, where it stands, and what is drawn at random."""

    name: str
    """Its name in the scene, in `GarmentEnv.objects`, in formulas and in the episode's draws."""
    prop: str | PropParameters
    """Kind of `dgl_assets.props`, or parameters of one."""
    position: Vector3
    """Nominal place of the object's frame [m], world frame; most stand on z = 0."""
    yaw: float = 0.0
    """Rotation about z [rad]."""
    x_range: Range = (0.0, 0.0)
    """Range of what is added to x [m]."""
    y_range: Range = (0.0, 0.0)
    """Range of what is added to y [m]."""
    friction: float = 0.5
    """A factor on the garment's friction."""
    is_solid_to_robot: bool = True
    """Whether the whole robot collides with it; its palms and fingers always do, unless the
    agent says otherwise."""

    def __post_init__(self) -> None:
        if not self.name.isidentifier():
            raise ValueError(f"name of an object must be an identifier; got {self.name!r}")
        _check_ranges(self, "x_range", "y_range")
        if not self.friction >= 0.0:
            raise ValueError(f"friction must be >= 0; got {self.friction}")


@dataclass(frozen=True, kw_only=True)
class Start:
    """How the garment is placed: it falls from a height and settles."""

    x_range: Range = (0.0, 0.0)
    """Range of the garment's centre in x [m]."""
    y_range: Range = (0.0, 0.0)
    """Range of the garment's centre in y [m]."""
    yaw: float = 0.0
    """Rotation of the garment about z [rad]."""
    roll_range: Range = (0.0, 0.0)
    """Range of the garment's rotation about x [rad], before the yaw: how steeply it stands when dropped."""
    height: float = 0.2
    """Height of its lowest point when it is dropped [m]."""
    settle_frames: int = 60
    """Frames of 1/60 s from the drop to the end of a reset."""
    value_below: float | None = None
    """What the task's rule has to measure less than: a garment that has fallen flatter than this is dropped again, 5 degrees
    steeper each time, since what only lifts it and lets it fall must not succeed. None takes it as it falls."""

    def __post_init__(self) -> None:
        _check_ranges(self, "x_range", "y_range", "roll_range")
        if self.settle_frames < 0:
            raise ValueError(f"settle_frames must be at least 0; got {self.settle_frames}")


@dataclass(frozen=True, kw_only=True)
class Task:
    """A garment-manipulation task."""

    id: str
    """Environment id, such as "FoldTops-v1"."""
    title: str
    category: str
    """Garment category in `dgl_assets`."""
    description: str
    success_text: str
    """The success rule in words."""
    start: Start
    success: SuccessRule
    objects: tuple[SceneObject, ...] = ()
    """What is in the scene besides robots and garment."""
    left_base: BasePlacement = DEFAULT_LEFT_BASE
    right_base: BasePlacement = DEFAULT_RIGHT_BASE
    cameras: Mapping[str, CameraPlacement]
    workspace: Workspace = field(default_factory=Workspace)
    material: ClothMaterial = field(default_factory=ClothMaterial)
    hand_friction: float = 3.0
    """Friction of the hands' rubber pads, a factor on the material's (25 in the original code). Of 1, hems and the corners
    of heaps slip out; what is flung by its shoulders needs more than what is folded."""
    ground_friction: float = 0.5
    """Friction of the ground (original code), a factor on the material's."""

    def __post_init__(self) -> None:
        names = [item.name for item in self.objects]
        if len(set(names)) < len(names):
            raise ValueError(f"objects must have different names; got {names}")


def _check_ranges(declared: object, *names: str) -> None:
    for name in names:
        low, high = getattr(declared, name)
        if not low <= high:
            raise ValueError(f"{name} must be (low, high) with low <= high; got {(low, high)}")
