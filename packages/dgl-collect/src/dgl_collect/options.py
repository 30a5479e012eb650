"""Options of a run: one frozen dataclass from the command line to the scene."""

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal, TypeVar

from annotated_types import Ge

from dgl_files.fields import STRICT, check_fields, from_plain

__all__ = [
    "CameraName",
    "CloudKind",
    "EvaluationOptions",
    "ExportContent",
    "ExportOptions",
    "GarmentChoice",
    "JointControlMode",
    "MatcherName",
    "RecordOptions",
    "RunOptions",
]

CloudKind = Literal["segmented", "scene"]
"""Clouds that policies see: garment and objects alone, or all in the workspace, robot included."""

JointControlMode = Literal["pd_joint_pos", "pd_hand_poses"]
"""Control modes of `dgl_tasks.inputs` whose actions are joint targets, or stand for them."""

ExportContent = Literal["whole", "grasped", "stages"]
MatcherName = Literal["exact", "gam"]
"""`exact` knows the simulated garment; `gam`, the Garment Affordance Model, sees clouds only."""

CameraName = Literal[
    "environment_camera",
    "video_camera",
    "garment_camera",
    "left_wrist_camera",
    "right_wrist_camera",
]
"""Cameras of every task."""

GarmentChoice = Literal["both", "train", "test"]
"""Garments of the training split, of the testing split, or of both by turns."""

O = TypeVar("O", bound="RunOptions")


@dataclass(frozen=True, kw_only=True)
class RunOptions:
    """Options of an attempt, whichever method acts.

    The command line makes a flag of each field. Workers receive the same object, a run's file
    records `to_plain()`, and a resumed run must have equal options.

    Raises:
        ValueError: If a field is of another type or out of range.
    """

    __pydantic_config__ = STRICT

    look: Literal["studio", "random"] = "studio"
    """A plain floor with contrasting fabrics, or any floor, mat and fabric."""
    cloud: CloudKind = "segmented"
    """Point cloud that policies see: `segmented` has garment and objects alone; `scene` has all in
    the workspace that is over 5 mm high, the robot included, as in the original."""
    garment: str | None = None
    """One garment for every attempt instead of a drawn one: an id of the catalogue, a mesh file of
    your own, or a folder made by `dgl assets import`."""
    matcher: MatcherName | None = None
    """Finds the demonstration's points: `exact` knows the simulated garment, `gam` is the Garment
    Affordance Model, which sees the cloud alone. Default: exact; gam for a garment of your own."""
    demonstration: Path | None = None
    """A demonstration of your own (JSON). Default: the one that belongs to the task."""
    rounds: Annotated[int, Ge(1)] | None = None
    """Most rounds through the stages while the task is believed not to be done; 1 is the paper's
    protocol. Default: as the demonstration says."""
    control_mode: JointControlMode = "pd_joint_pos"
    """Actions: a target of each joint, or those of the arms' joints and weights of hand poses, 22
    numbers, which `pd_hand_poses` has. Commands of all methods are brought into this form."""
    robot: str = "ur10e+shadow"
    """Arm and hand, ARM+HAND; one name alone stands for itself with the built-in other."""
    robots: Path | None = None
    """Folder of imported robots; see `dgl assets import-robot`."""
    render_backend: Literal["cpu", "gpu"] | None = None
    """Renderer of ManiSkill. Default: gpu if CUDA is available, else cpu."""

    def __post_init__(self) -> None:
        check_fields(self)
        if self.garment == "":
            raise ValueError("garment must be an id, a mesh file or a folder; got ''")

    def to_plain(self) -> dict[str, object]:
        """Return the fields that differ from their defaults, ready for JSON."""
        values = {item.name: getattr(self, item.name) for item in dataclasses.fields(self)}
        return {
            name: str(value) if isinstance(value, Path) else value
            for name, value in values.items()
            if value != getattr(type(self), name, dataclasses.MISSING)
        }

    @classmethod
    def from_plain(cls: type[O], values: Mapping[str, object]) -> O:
        """Build options from what `to_plain` gave.

        Raises:
            ValueError: If a field is unknown, of another type or out of range.
        """
        return from_plain(cls, dict(values))


@dataclass(frozen=True, kw_only=True)
class RecordOptions(RunOptions):
    """Options of a collection."""

    policy: Literal["expert", "primitive"] = "expert"
    """expert: the demonstration's steps; primitive: the ways that were learnt from recordings."""
    record: Literal["stages", "approaches"] = "stages"
    """Recorded parts: the stages from the grasp points on, or also the approaches before them,
    which policies without grasp points must learn."""


@dataclass(frozen=True, kw_only=True)
class EvaluationOptions(RunOptions):
    """Options of an evaluation."""

    policy: str
    """The method: nothing, lift-drop, expert; learned: primitive, blind, halo, sadp, gam-dp3, dp3,
    dp; module:factory of your own; or ws://HOST:PORT, a policy server that speaks openpi's
    protocol."""
    garments: GarmentChoice = "both"
    """Garments of the training split, of the testing split, or of both by turns."""
    friction: Annotated[float, Ge(0)] = 1.0
    """A factor on the garment's friction and adhesion: at 0 no hand can hold it, and no method must
    succeed."""
    checkpoints: Path | None = None
    """Trained policies of a learned method: the folder of a training, or its file. Default
    of primitive, blind and halo: what comes with dgl-sadp."""
    chunks: Annotated[int, Ge(1)] | None = None
    """Predictions in each stage. Default: enough for the longest recording."""
    actions: Annotated[int, Ge(1)] = 600
    """Most actions of a policy of your own, each five control steps; 600 are 50 s."""
    device: Literal["cpu", "cuda"] = "cpu"
    """Device on which policies compute."""


@dataclass(frozen=True, kw_only=True)
class ExportOptions:
    """Content of exported frames.

    Raises:
        ValueError: If a field is of another type or out of range.
    """

    __pydantic_config__ = STRICT

    content: ExportContent = "whole"
    """whole: each episode from the first movement of the parked arms until the hands have drawn
    back, approaches included, by replay; grasped: the same from the grasp points of the first
    recorded stage on; stages: each recorded stage as an episode of its own, as recorded."""
    control_mode: JointControlMode = "pd_joint_pos"
    """Form of states and actions: a number for each joint, or 22, joints of the arms and weights of
    hand poses."""
    cameras: tuple[CameraName, ...] = ("environment_camera",)
    """Cameras: `environment_camera` ahead, `video_camera` near, `garment_camera` above, and those
    behind the hands."""
    size: tuple[Annotated[int, Ge(16)], Annotated[int, Ge(16)]] = (320, 240)
    """Width and height of the pictures [pixels]."""
    cloud: bool = False
    """Add the environment's point cloud to each frame."""
    matcher: MatcherName = "gam"
    """Finds the demonstration's points, whose places at the start are part of each frame."""
    robots: Path | None = None
    """Folder of imported robots, for episodes of a robot that is not built in."""

    def __post_init__(self) -> None:
        check_fields(self)
        if len(set(self.cameras)) < len(self.cameras):
            raise ValueError(f"cameras must differ; got {', '.join(self.cameras)}")
        if self.content == "stages" and set(self.cameras) - {"environment_camera"}:
            raise ValueError(
                "stages hold pictures of the environment_camera alone; got "
                f"{', '.join(self.cameras)}: take whole episodes"
            )
