"""Masses of links: missing ones are merged into a neighbour or get a small stated value."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dgl_assets.robots.importing.raw import RawLink, RawRobot

NO_INERTIA = 1e-12
"""Moment below which a link counts as a point [kg m^2], that of a ball of 1 mg and 1 mm."""
THIN = 1e-3
"""Least moment over the largest one; a rod or a plate without thickness in the file gets it."""
SMALL_MASS = 0.01
"""Mass of a link that moves and has none in the file [kg]."""
SMALL_RADIUS = 0.02
"""Radius of the ball whose inertia a link gets where it moves and has none in the file [m]."""
_LISTED = 8


def settle_masses(robot: RawRobot) -> tuple[RawRobot, list[str]]:
    """Give every body that moves a mass and an inertia.

    Links without inertia that are fixed to another link, such as fingertips, become frames, and
    their mass a point of the other link. A link that moves without a mass, or as a point, gets a
    small one.

    Args:
        robot: Robot as in its file; links may lack mass or inertia.

    Returns:
        The robot, and the assumptions.
    """
    links = {link.name: link for link in robot.links}
    notes = []
    # Children come after their parents: from the tips on, points are passed to the next link.
    merged = []
    for joint in reversed(robot.joints):
        child = links[joint.child]
        if joint.axis is None and child.mass > 0.0 and _is_point(child):
            links[joint.parent] = _add_point(
                links[joint.parent],
                child.mass,
                (joint.joint_to_parent @ child.inertial_to_link)[:3, 3],
            )
            links[joint.child] = _make_frame(child)
            merged.append(joint.child)
    if merged:
        notes.append(
            "links without inertia count as points of what they are fixed to: "
            f"{_list(merged[::-1])}"
        )
    masses = {name: link.mass for name, link in links.items()}
    light, points, thin = [], [], []
    moved = {joint.child: joint.axis is not None for joint in robot.joints}
    for joint in reversed(robot.joints):
        if joint.axis is None:
            masses[joint.parent] += masses[joint.child]
        elif masses[joint.child] <= 0.0:
            links[joint.child] = _make_ball(links[joint.child], SMALL_MASS)
            light.append(joint.child)
    for name, link in links.items():
        if link.mass > 0.0 and _is_point(link) and moved.get(name, True):
            links[name] = _make_ball(link, link.mass)
            points.append(name)
        elif link.mass > 0.0 and not _is_point(link):
            moments, axes = np.linalg.eigh(link.inertia)
            if moments[0] < 0.5 * THIN * moments[2]:
                moments = np.maximum(moments, THIN * moments[2])
                links[name] = replace(link, inertia=axes @ np.diag(moments) @ axes.T)
                thin.append(name)
    if thin:
        notes.append(
            f"links whose inertia has no thickness in the file get {THIN:g} of their largest "
            f"moment: {_list(thin)}"
        )
    if light:
        notes.append(
            f"links that move without mass in the file get {SMALL_MASS:g} kg: {_list(light[::-1])}"
        )
    if points:
        notes.append(
            f"links without inertia in the file get that of a ball of {SMALL_RADIUS * 100:g} cm "
            f"radius: {_list(points)}"
        )
    return replace(robot, links=tuple(links[link.name] for link in robot.links)), notes


def _is_point(link: RawLink) -> bool:
    return float(np.abs(link.inertia).max()) < NO_INERTIA


def _make_frame(link: RawLink) -> RawLink:
    return replace(link, mass=0.0, inertial_to_link=np.eye(4), inertia=np.zeros((3, 3)))


def _make_ball(link: RawLink, mass: float) -> RawLink:
    return replace(link, mass=mass, inertia=0.4 * mass * SMALL_RADIUS**2 * np.eye(3))


def _add_point(link: RawLink, mass: float, place: np.ndarray) -> RawLink:
    """Add a point mass to a link; `place` is in its frame [m], shape (3,)."""
    T = link.inertial_to_link if link.mass > 0.0 else np.eye(4)
    total = link.mass + mass
    centre = (link.mass * T[:3, 3] + mass * place) / total
    inertia = link.inertia if link.mass > 0.0 else np.zeros((3, 3))
    for part, where in ((link.mass, T[:3, 3]), (mass, place)):
        arm = T[:3, :3].T @ (where - centre)
        inertia = inertia + part * (float(arm @ arm) * np.eye(3) - np.outer(arm, arm))
    moved = T.copy()
    moved[:3, 3] = centre
    return replace(link, mass=total, inertial_to_link=moved, inertia=inertia)


def _list(names: Sequence[str]) -> str:
    return ", ".join(names[:_LISTED]) + (", ..." if len(names) > _LISTED else "")
