"""Options of importing a robot: one frozen dataclass from the command line to the importer."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from dgl_files.fields import STRICT, check_fields

RobotKind = Literal["arm", "hand", "pair"]
CollisionMethod = Literal["capsules", "coacd", "keep"]


@dataclass(frozen=True, kw_only=True)
class RobotImportOptions:
    """Options of an import; the importer finds values that are None.

    The command line makes a flag of each field.

    Raises:
        ValueError: If a field is of another type.
    """

    __pydantic_config__ = STRICT

    collision: CollisionMethod = "capsules"
    """Collision shapes of meshes: fitted capsules, convex pieces by CoACD, or one convex hull
    each."""
    root: str | None = None
    """Import only what hangs on this link."""
    ee_link: str | None = None
    """Link that an arm's tool is mounted on; the end of the chain otherwise."""
    hand_link: str | None = None
    """First link of a pair's hand."""
    tool_axis: str = "+z"
    """Direction of the fingers in the link that the tool is mounted on."""
    tool_palm: str | None = None
    """Direction out of the palm there; the one that lets the arm reach most otherwise."""
    fingers_axis: str | None = None
    """Direction of the straight fingers in the hand's first link."""
    palm_axis: str | None = None
    """Direction out of the palm in the hand's first link."""
    thumb: str | None = None
    """A link of the thumb."""
    side: Literal["left", "right"] | None = None
    """Side of the hand in the file; found from the thumb otherwise."""
    mount_offset: float | None = None
    """Distance from the flange to the hand's first link along the fingers [m]."""
    grasp_point: tuple[float, float, float] | None = None
    """Place between the fingers of the right hand that tasks lead, axes of ee [m]."""
    home: Path | None = None
    """JSON of where the arms start: {"left": {joint: value}, "right": {...}}."""
    poses: Path | None = None
    """JSON of hand poses: {"open": {joint: value}, ...}; those that it lacks are found."""
    packages: Mapping[str, Path] = field(default_factory=dict)
    """Folders of ROS packages that the file refers to: NAME FOLDER ..."""
    licence: str = ""
    """Licence under which you have it; recorded in robot.json, never judged."""
    source: str = ""
    """Origin of the file; recorded in robot.json."""
    overwrite: bool = False
    """Replace a robot of the same name."""

    def __post_init__(self) -> None:
        check_fields(self)
