"""Content of a robot description, checked entry by entry."""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

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


def pack_robot(robot: RawRobot) -> dict[str, Any]:
    """Turn a robot into plain values and arrays, to pass it between processes."""
    plain = asdict(robot)
    for link in plain["links"]:
        for shape in (*link["visuals"], *link["collisions"]):
            shape["path"] = None if shape["path"] is None else str(shape["path"])
    return plain


def unpack_robot(plain: dict[str, Any]) -> RawRobot:
    """Make a robot of what `pack_robot` gave."""
    return RawRobot(
        name=plain["name"],
        links=tuple(
            RawLink(
                **{
                    **link,
                    "visuals": tuple(map(_unpack_shape, link["visuals"])),
                    "collisions": tuple(map(_unpack_shape, link["collisions"])),
                }
            )
            for link in plain["links"]
        ),
        joints=tuple(
            RawJoint(**{**joint, "axis": joint["axis"] and tuple(joint["axis"])})
            for joint in plain["joints"]
        ),
    )


def _unpack_shape(plain: dict[str, Any]) -> RawShape:
    values: dict[str, Any] = {k: tuple(v) if isinstance(v, list) else v for k, v in plain.items()}
    path = values.pop("path")
    return RawShape(**values, path=None if path is None else Path(path))
