"""Content of a robot description, checked entry by entry."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from dgl_assets.robots.tree import TreeJoint, TreeLink

Rgba = tuple[float, float, float, float]


@dataclass(frozen=True, kw_only=True)
class RawShape:
    """A visual or collision element."""

    kind: Literal["box", "cylinder", "sphere", "capsule", "mesh"]
    shape_to_link: np.ndarray
    """Pose in the link, shape (4, 4)."""
    size: tuple[float, ...] = ()
    """Full sizes of a box; radius and length of a cylinder and of a capsule without its caps;
    radius of a sphere [m]."""
    path: Path | None = None
    """File of a mesh."""
    scale: tuple[float, float, float] = (1.0, 1.0, 1.0)
    """Scale of a mesh."""
    rgba: Rgba | None = None
    """Colour of a visual element."""


@dataclass(frozen=True, kw_only=True)
class RawLink(TreeLink):
    """A link; its mass is zero where the file gives no inertia."""

    visuals: tuple[RawShape, ...] = ()
    collisions: tuple[RawShape, ...] = ()


@dataclass(frozen=True, kw_only=True)
class RawJoint(TreeJoint):
    """A joint; effort and speed are zero where the file gives none."""

    is_endless: bool = False
    """A continuous joint, without limits."""
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
