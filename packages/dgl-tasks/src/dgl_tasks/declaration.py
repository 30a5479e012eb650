"""What a task is: data. The machinery that runs it is shared by all tasks.

A declaration says where robots and garment start, what is drawn at random, in which stages the
work is done, and what counts as success. The same declaration serves collection and evaluation.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from dgl_assets.props import PropParameters
from dgl_assets.robots import DEFAULT_LEFT_BASE, DEFAULT_RIGHT_BASE, BasePlacement, Side
from dgl_physics import ClothMaterial
from dgl_tasks.cameras import CameraPlacement, Workspace
from dgl_tasks.grasps import GRASP_ORIENTATIONS, GraspName, point_along_fingers
from dgl_tasks.leaving import LeaveName
from dgl_tasks.success import SuccessRule

Range = tuple[float, float]
Vector3 = tuple[float, float, float]

FLING_ROLL: Range = (float(np.radians(65)), float(np.radians(80)))
"""Range of the tilt of a garment that lands in a heap [rad] (paper)."""
FLING_GRASP_HEIGHT = 0.0
"""Height of the grasp point in a heap [m]: the fingers reach down to the ground, and take hold of all layers."""
FLING_ROUNDS = 6
"""How often a garment is flung at most: what has stayed folded is flung again, from flatter than it first lay."""


@dataclass(frozen=True, kw_only=True)
class Stage:
    """One learned part of a task: from the hands at the grasp points to the release."""

    name: str
    grasp: Mapping[Side, str | tuple[str, ...]]
    """Name of the point that each working hand grasps, as the demonstration marks it. Of several, the hand
    grasps midway between them: so it takes hold of layers that do not lie quite on each other."""
    orientation: GraspName = "standard"
    grasp_height: float = 0.03
    """Height of the grasp point over the ground [m]: the hand closes around what lies there."""
    short_by: float = 0.0
    """How far before the grasp point the hand stops, along its fingers [m]: it takes less of what lies beyond."""
    looks_again: bool = False
    """The points of the waypoints are found anew when the stage begins, instead of those on the initial
    garment: for a garment that the stages before have laid out differently."""
    moved_at_most: float | None = 0.15
    """How far the grasp points may have moved since the garment was first seen [m]: they are looked for this near
    to where they lay then, as what is folded no longer tells left from right. None where an earlier stage has
    moved them on purpose."""
    leave: LeaveName = "slide"
    """How the hands leave the cloth, see `dgl_tasks.leaving`."""
    policy_loops: int = 8
    """Predictions of four actions that a policy gets for this stage (original code)."""

    def get_grasp_names(self, side: Side) -> tuple[str, ...]:
        """Name the points between which a hand grasps; of a hand that rests, those of the other one."""
        names = self.grasp.get(side, next(iter(self.grasp.values())))
        return (names,) if isinstance(names, str) else names

    def place_grasp(self, side: Side, point: np.ndarray) -> np.ndarray:
        """Say where a hand takes hold of a point that it has been shown [m], shape (2,) or (3,): shape (3,)."""
        grasp = np.array([point[0], point[1], self.grasp_height], dtype=float)
        if self.short_by:
            fingers = point_along_fingers(GRASP_ORIENTATIONS[self.orientation][side])
            grasp -= self.short_by * fingers
        return grasp


@dataclass(frozen=True, kw_only=True)
class PropPlacement:
    """A prop of a task: what it is, where it stands, and what is drawn at random."""

    name: str
    """Its name in the scene, in `GarmentEnv.props` and in the episode's draws."""
    prop: str | PropParameters
    """Kind, such as "hanger", or parameters of `dgl_assets.props`."""
    position: Vector3
    """Nominal place of the prop's frame [m], world frame; most stand on z = 0."""
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
        for name in ("x_range", "y_range"):
            low, high = getattr(self, name)
            if not low <= high:
                raise ValueError(f"{name} must be (low, high) with low <= high; got {(low, high)}")
        if not self.friction >= 0.0:
            raise ValueError(f"friction must be >= 0; got {self.friction}")


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
    stages: tuple[Stage, ...]
    success: SuccessRule
    """Its points are found on the initial cloud."""
    rounds: int = 1
    """How often the stages are gone through at most: an expert that sees the task not done after the last one begins
    again, from where the garment lies then."""
    again_from: int = 0
    """Number of the stage with which a further round begins; the first is 0. Those before are not undone by what
    fails later."""
    nearly_done: float | None = None
    """The rule's value, as it is seen, from which on the work of the stage `again_from` is kept: the stages after it
    follow though a hand has lost the garment in it, and they alone are a further round, unless the last one was that
    already. None always begins with it."""
    turns_over: bool = False
    """The garment may come to lie on its face, its left to the right: the hands exchange their points then."""
    x_range: Range
    """Range of the garment's centre in x [m]."""
    y_range: Range
    """Range of the garment's centre in y [m]."""
    yaw: float = 0.0
    """Rotation of the garment about z [rad]."""
    roll_range: Range = (0.0, 0.0)
    """Range of the garment's rotation about x [rad], before the yaw: how steeply it stands when dropped."""
    start_below: float | None = None
    """The rule's value that the start has to be below: a garment that has fallen flatter than this is dropped again,
    5 degrees steeper each time, since what nearly lies flat need not be flung, and what only lifts it and lets it fall
    must not succeed. None takes it as it falls."""
    drop_height: float = 0.2
    """Height of its lowest point when it is dropped [m]."""
    settle_frames: int = 60
    """Frames of 1/60 s from the drop to the end of a reset."""
    props: tuple[PropPlacement, ...] = ()
    """What stands in the scene besides robots and garment."""
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
        for name in ("x_range", "y_range", "roll_range"):
            low, high = getattr(self, name)
            if not low <= high:
                raise ValueError(f"{name} must be (low, high) with low <= high; got {(low, high)}")
        names = [placement.name for placement in self.props]
        if len(set(names)) < len(names):
            raise ValueError(f"props must have different names; got {names}")
        if not self.stages:
            raise ValueError(f"task {self.id} must have at least one stage")
        if self.rounds < 1:
            raise ValueError(f"rounds must be at least 1; got {self.rounds}")
        if not 0 <= self.again_from < len(self.stages):
            raise ValueError(
                f"again_from must be in 0..{len(self.stages) - 1}; got {self.again_from}"
            )
        if self.nearly_done is not None and self.again_from == len(self.stages) - 1:
            raise ValueError("nearly_done needs a stage after again_from; there is none")
