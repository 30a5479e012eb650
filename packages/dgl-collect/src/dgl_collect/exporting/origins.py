"""Origins of the episodes of a data set, in a file beside the format's own."""

import dataclasses
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from dgl_collect.options import CloudKind, ExportContent, JointControlMode, MatcherName
from dgl_files.fields import STRICT, check_fields, read_json_file
from dgl_files.whole import write_json

__all__ = ["FILE", "Origin", "Origins", "read_origins", "write_origins"]

FILE = "dexgarmentlab.json"


@dataclass(frozen=True, kw_only=True)
class Origin:
    """Origin of one episode."""

    __pydantic_config__ = STRICT

    seed: int
    """Seed of its environment."""
    garment: str
    """Id of its garment."""
    success: bool
    """The rule was met at its end."""


@dataclass(frozen=True, kw_only=True)
class Origins:
    """Origin of a data set: what all of its episodes share, and each of them.

    Raises:
        ValueError: If a field is of another type.
    """

    __pydantic_config__ = STRICT

    task: str
    """Environment id."""
    robot: str
    """Name of arm and hand."""
    cloud: CloudKind
    """Kind of environment clouds."""
    look: Literal["studio", "random"]
    """Look of the scene."""
    control_mode: JointControlMode = "pd_joint_pos"
    """Form of states and actions."""
    content: ExportContent = "whole"
    """Whole episodes, the same from the grasp points on, or stages."""
    matcher: MatcherName = "gam"
    """Finds the places at the start."""
    episodes: tuple[Origin, ...] = ()
    """The episodes in their order."""

    def __post_init__(self) -> None:
        check_fields(self)


def write_origins(folder: Path, origins: Origins) -> None:
    """Write the file into the folder of a data set."""
    write_json(folder / FILE, dataclasses.asdict(origins))


def read_origins(folder: Path) -> Origins:
    """Read the file in the folder of a data set.

    Raises:
        ValueError: If there is none, or it is damaged.
    """
    path = folder / FILE
    if not path.is_file():
        raise ValueError(f"{folder} holds no data set of dgl export: {FILE} is missing")
    return read_json_file(Origins, path)
