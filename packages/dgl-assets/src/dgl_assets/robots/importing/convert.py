"""From a description as read to a kinematic tree with its pictures and collision shapes."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from hashlib import sha256
from math import pi

import numpy as np

from dgl_assets.importing.bounds import MAX_PIXELS, check_count
from dgl_assets.robots.collision import CollisionShape
from dgl_assets.robots.importing.collision import build_collision
from dgl_assets.robots.importing.masses import settle_masses
from dgl_assets.robots.importing.meshes import (
    count_vertices_and_pixels,
    encode_visuals,
    load_geometry,
)
from dgl_assets.robots.importing.options import CollisionMethod
from dgl_assets.robots.importing.raw import RawJoint, RawLink, RawRobot
from dgl_assets.robots.tree import KinematicTree, TreeJoint, TreeLink
from dgl_assets.robots.visual import LinkMeshes

MAX_SHAPES = 2000
"""Most visual and collision elements of a part."""
MAX_VERTICES = 4_000_000
"""Most vertices of all meshes of a part, each as often as it is used."""
DEFAULT_SPEED = {"revolute": 2.0, "prismatic": 0.2}
"""Speed of joints whose file says nothing [rad/s or m/s]."""


@dataclass(frozen=True, kw_only=True)
class ConvertedPart:
    """An arm or a hand, ready to be examined and written."""

    tree: KinematicTree
    meshes: LinkMeshes
    assumptions: tuple[str, ...]
    """Values that the file lacks or gives otherwise."""


def convert(
    robot: RawRobot,
    method: CollisionMethod,
    *,
    rename: Callable[[str], str] = lambda name: name,
    on_link: Callable[[str], None] | None = None,
) -> ConvertedPart:
    """Make the tree of a part.

    Args:
        robot: What was read.
        method: How collision shapes are made.
        rename: Gives the new name of each link and joint.
        on_link: Called with the name of each link when its shapes are made.

    Raises:
        AssetImportError: If a mesh cannot be used.
    """
    robot, notes = settle_masses(robot)
    check_count(
        sum(len(link.visuals) + len(link.collisions) for link in robot.links),
        MAX_SHAPES,
        "visual and collision elements",
        robot.name,
    )
    joints = tuple(_convert_joint(joint, rename, notes) for joint in robot.joints)
    links, files, by_link = [], {}, {}
    vertices = pixels = 0
    for link in robot.links:
        for shape in (*link.visuals, *link.collisions):
            if shape.path is not None:
                more = count_vertices_and_pixels(shape.path)
                vertices, pixels = vertices + more[0], pixels + more[1]
        check_count(vertices, MAX_VERTICES, "vertices in all its meshes", robot.name)
        check_count(pixels, 4 * MAX_PIXELS, "pixels in all its pictures", robot.name)
        if on_link is not None:
            on_link(link.name)
        tree_link, shown = _convert_link(link, method, rename, files)
        links.append(tree_link)
        if shown:
            by_link[tree_link.name] = shown
    return ConvertedPart(
        tree=KinematicTree(links=tuple(links), joints=joints),
        meshes=LinkMeshes(files=files, by_link=by_link),
        assumptions=tuple(notes),
    )


def _convert_link(
    link: RawLink, method: CollisionMethod, rename: Callable[[str], str], files: dict[str, bytes]
) -> tuple[TreeLink, tuple[str, ...]]:
    shapes, hulls = build_collision(link, method)
    names = {old: _name_file(old, data) for old, data in hulls.items()}
    files |= {names[old]: data for old, data in hulls.items()}
    pieces = [piece for shape in link.visuals for piece in load_geometry(shape)]
    shown: tuple[str, ...] = ()
    if pieces:
        data = encode_visuals(pieces)
        shown = (_name_file(f"{link.name}.glb", data),)
        files[shown[0]] = data
    name = rename(link.name)
    return (
        TreeLink(
            name=name,
            mass=link.mass,
            inertial_to_link=link.inertial_to_link,
            inertia=link.inertia,
            collision=tuple(_rename_shape(shape, name, names) for shape in shapes),
        ),
        shown,
    )


def _rename_shape(shape: CollisionShape, link: str, names: dict[str, str]) -> CollisionShape:
    return replace(shape, link=link, mesh=names.get(shape.mesh, ""))


def _name_file(name: str, data: bytes) -> str:
    """Name a file after its content, so that parts never disagree about a name."""
    stem, _, suffix = name.rpartition(".")
    return f"{stem}_{sha256(data).hexdigest()[:8]}.{suffix}"


def _convert_joint(joint: RawJoint, rename: Callable[[str], str], notes: list[str]) -> TreeJoint:
    lower, upper, speed = joint.lower, joint.upper, joint.speed
    if joint.is_endless:
        lower, upper = -2 * pi, 2 * pi
        notes.append(f"joint {joint.name} turns without end; limited to two turns")
    if joint.axis is not None and speed == 0.0:
        speed = DEFAULT_SPEED[joint.kind]
        notes.append(f"joint {joint.name} has no speed limit; {speed:g} assumed")
    if joint.axis is not None and joint.mimic is not None:
        notes.append(
            f"joint {joint.name} follows {joint.mimic} in the file; here it moves by itself"
        )
    return replace(
        joint,
        name=rename(joint.name),
        parent=rename(joint.parent),
        child=rename(joint.child),
        lower=lower,
        upper=upper,
        speed=speed,
        is_endless=False,
        mimic=None,
    )


def compute_moments(tree: KinematicTree, positions: Sequence[float]) -> np.ndarray:
    """Compute the inertia that each moving joint feels when it alone accelerates.

    Args:
        tree: Part of a robot.
        positions: Of its moving joints [rad or m].

    Returns:
        Diagonal of the joint-space inertia [kg m^2 or kg], shape (n,).
    """
    poses = tree.compute_link_poses(dict(zip(tree.moving_joint_names, positions, strict=True)))
    below: dict[str, set[str]] = {link.name: {link.name} for link in tree.links}
    for joint in reversed(tree.joints):
        below[joint.parent] |= below[joint.child]
    moments = []
    for joint in tree.joints:
        if joint.axis is None:
            continue
        T = poses[joint.child]
        axis, origin = T[:3, :3] @ np.array(joint.axis), T[:3, 3]
        total = 0.0
        for link in tree.links:
            if link.name not in below[joint.child] or link.mass == 0.0:
                continue
            if joint.kind == "prismatic":
                total += link.mass
                continue
            inertial = poses[link.name] @ link.inertial_to_link
            arm = np.cross(axis, inertial[:3, 3] - origin)
            local = inertial[:3, :3].T @ axis
            total += link.mass * float(arm @ arm) + float(local @ link.inertia @ local)
        moments.append(total)
    return np.array(moments)
