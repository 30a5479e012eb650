"""What a task is: data. The machinery that runs it is shared by all tasks.

A declaration says what is in the scene, what is drawn at random, and what counts as success. How the work is done is a
demonstration's to say (`dgl_collect.demonstration`); the same declaration serves collection and evaluation.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from dgl_assets.garments.catalogue import choose_categories
from dgl_assets.props import PropParameters
from dgl_assets.robots import DEFAULT_LEFT_BASE, DEFAULT_RIGHT_BASE, BasePlacement
from dgl_physics import ClothMaterial, SolidMaterial
from dgl_tasks.cameras import CameraPlacement, Workspace
from dgl_tasks.fields import Range, Vector3, check_fields
from dgl_tasks.success import SuccessRule

SolidTo = Literal["robot", "hands", "garment"]
"""What collides with an object: the whole robot, its palms and fingers, or the garment alone; the garment always does."""

CAMERAS = ("garment_camera", "environment_camera", "video_camera")
"""What every task has: a camera that looks down on the garment, one that policies see by, and one for people."""
RESERVED_NAMES = ("garment", "now", "ground")
"""Names that formulas and the scene have for other things than objects."""


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
    solid_to: SolidTo = "robot"
    """What collides with it besides the garment: the whole robot, its palms and fingers alone, or nothing else."""

    def __post_init__(self) -> None:
        check_fields(self)
        if not self.name.isidentifier() or self.name in RESERVED_NAMES:
            raise ValueError(
                f"name of an object must be an identifier other than {', '.join(RESERVED_NAMES)}; got {self.name!r}"
            )
        _check_ranges(self, "x_range", "y_range")
        if self.friction < 0.0:
            raise ValueError(f"friction must be >= 0; got {self.friction}")


@dataclass(frozen=True, kw_only=True)
class HandFriction:
    """Friction of the hands' rubber pads, by part: factors on the material's (25 in the original code)."""

    fingers: float = 3.0
    """Of palm and fingers. Of 1, hems and the corners of heaps slip out; what is flung by its shoulders needs more than
    what is folded."""
    thumb: float | None = None
    """Of the thumb, which lies inside of what hangs over a bar as the hand leaves; as the fingers' when None."""

    def __post_init__(self) -> None:
        check_fields(self)
        for name in ("fingers", "thumb"):
            value = getattr(self, name)
            if value is not None and value < 0.0:
                raise ValueError(f"{name} must be >= 0; got {value}")


@dataclass(frozen=True, kw_only=True)
class Start:
    """How the garment is placed: it falls from a height and settles."""

    on: str | None = None
    """A place of an object that it is put on, such as "stand.top": what follows is relative to it. The ground when None."""
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
        check_fields(self)
        _check_ranges(self, "x_range", "y_range", "roll_range")
        if self.height < 0:
            raise ValueError(f"height must be at least 0; got {self.height}")
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
    """Of the names `CAMERAS`."""
    picture_camera: str = "garment_camera"
    """Which of them takes the picture of an episode's end."""
    workspace: Workspace = field(default_factory=Workspace)
    material: ClothMaterial | SolidMaterial = field(default_factory=ClothMaterial)
    """Of the garment: of cloth, or of the wall of an elastic shell."""
    stiffness: Mapping[str, float] = field(default_factory=dict)
    """Of a shell: factor on the material's Young's modulus by panel of the garment, where it is not 1."""
    hand_friction: HandFriction = field(default_factory=HandFriction)
    ground_friction: float = 0.5
    """Friction of the ground (original code), a factor on the material's."""

    def __post_init__(self) -> None:
        if isinstance(self.success, type):
            name = self.success.__name__
            raise ValueError(f"success must be a rule, such as {name}(...); got the class {name}")
        check_fields(self)
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
