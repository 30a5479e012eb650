"""A robot description as it stands in its file, checked entry by entry."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

JointKind = Literal["revolute", "continuous", "prismatic", "fixed"]
Rgba = tuple[float, float, float, float]


@dataclass(frozen=True, kw_only=True)
class RawShape:
    """A visual or collision element."""

    kind: Literal["box", "cylinder", "sphere", "capsule", "mesh"]
    shape_to_link: np.ndarray
    """Pose in the link, shape (4, 4)."""
    size: tuple[float, ...] = ()
    """Box: full sizes; cylinder and capsule: radius and length (of a capsule without caps); sphere: radius [m]."""
    path: Path | None = None
    """File of a mesh."""
    scale: tuple[float, float, float] = (1.0, 1.0, 1.0)
    """Scale of a mesh."""
    rgba: Rgba | None = None
    """Colour of a visual element."""


@dataclass(frozen=True, kw_only=True)
class RawLink:
    """A link."""

    name: str
    mass: float
    """Mass [kg]; zero where the file gives no inertia."""
    inertial_to_link: np.ndarray
    """Pose of the inertial frame, shape (4, 4)."""
    inertia: np.ndarray
    """Inertia at the centre of mass [kg m^2], shape (3, 3)."""
    visuals: tuple[RawShape, ...] = ()
    collisions: tuple[RawShape, ...] = ()


@dataclass(frozen=True, kw_only=True)
class RawJoint:
    """A joint."""

    name: str
    kind: JointKind
    parent: str
    child: str
    joint_to_parent: np.ndarray
    """Constant pose in the parent, shape (4, 4)."""
    axis: tuple[float, float, float]
    """Unit axis in the joint's frame."""
    lower: float = 0.0
    upper: float = 0.0
    """Limits [rad or m]; both zero for continuous and fixed joints."""
    effort: float = 0.0
    """Largest torque [N m] or force [N]; zero where the file says nothing."""
    speed: float = 0.0
    """Largest speed [rad/s or m/s]; zero where the file says nothing."""
    mimic: str | None = None
    """Joint that this one is said to follow."""


@dataclass(frozen=True, kw_only=True)
class RawRobot:
    """A description whose links and joints are one tree, parents before their children."""

    name: str
    links: tuple[RawLink, ...]
    joints: tuple[RawJoint, ...]

    @property
    def root(self) -> str:
        """Name of the first link."""
        return self.links[0].name
