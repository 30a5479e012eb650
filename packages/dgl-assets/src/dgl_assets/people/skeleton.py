"""Joints of a person, their motions and limits, and forward kinematics."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

FINGERS = ("thumb", "index", "middle", "ring", "little")
REST_ABDUCTION = 0.80
"""Angle between trunk and arms in the rest pose [rad]."""


@dataclass(frozen=True, kw_only=True)
class Motion:
    """One rotation of a joint."""

    name: str
    """Such as "flexion"."""
    axis: tuple[float, float, float]
    """Unit axis for hanging arms and palms inward, person frame."""
    low: float
    """Smallest angle [rad]; 0 is standing with hanging arms."""
    high: float
    """Largest angle [rad]."""
    rest: float = 0.0
    """Angle in the rest pose [rad]."""


@dataclass(frozen=True, kw_only=True)
class Joint:
    """A joint, and the bone that it moves."""

    name: str
    """Such as "left_elbow"."""
    parent: str | None
    """Joint of the bone that carries it; None for the pelvis."""
    motions: tuple[Motion, ...]
    """The first is the outermost: it turns the axes of those after it."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Skeleton:
    """Joints with their positions in the rest pose."""

    joints: tuple[Joint, ...]
    """Parents before children."""
    positions: np.ndarray
    """In the rest pose [m], shape (J, 3), person frame."""
    frames: np.ndarray
    """Rotations that take axes from hanging arms to the rest pose, shape (J, 3, 3)."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the joints."""
        return tuple(joint.name for joint in self.joints)

    @property
    def parents(self) -> np.ndarray:
        """Index of each joint's parent, -1 for the pelvis, shape (J,)."""
        index = {joint.name: k for k, joint in enumerate(self.joints)}
        return np.array([-1 if j.parent is None else index[j.parent] for j in self.joints])

    @property
    def limits(self) -> dict[str, tuple[float, float]]:
        """Smallest and largest angle [rad] of each motion, by "<joint>_<motion>"."""
        return {
            f"{joint.name}_{motion.name}": (motion.low, motion.high)
            for joint in self.joints
            for motion in joint.motions
        }

    def compute_transforms(self, angles: Mapping[str, float]) -> np.ndarray:
        """Compute the motion of each bone from the rest pose.

        Args:
            angles: Angle [rad] of motions by "<joint>_<motion>"; those not named keep their rest.

        Returns:
            Rigid transforms of points in the person frame, shape (J, 4, 4).

        Raises:
            ValueError: If a motion does not exist or is out of its limits.
        """
        self._check(angles)
        parents = self.parents
        result = np.zeros((len(self.joints), 4, 4))
        for k, joint in enumerate(self.joints):
            turn = np.eye(3)
            rest = np.eye(3)
            for motion in joint.motions:
                angle = angles.get(f"{joint.name}_{motion.name}", motion.rest)
                axis = np.array(motion.axis)
                turn = turn @ Rotation.from_rotvec(angle * axis).as_matrix()
                rest = rest @ Rotation.from_rotvec(motion.rest * axis).as_matrix()
            local = np.eye(4)
            local[:3, :3] = self.frames[k] @ turn @ rest.T @ self.frames[k].T
            local[:3, 3] = self.positions[k] - local[:3, :3] @ self.positions[k]
            result[k] = local if parents[k] < 0 else result[parents[k]] @ local
        return result

    def _check(self, angles: Mapping[str, float]) -> None:
        limits = self.limits
        unknown = sorted(set(angles) - set(limits))
        if unknown:
            raise ValueError(f"unknown motions {unknown}; expected some of {sorted(limits)}")
        for name, angle in angles.items():
            low, high = limits[name]
            if not (math.isfinite(angle) and low - 1e-9 <= angle <= high + 1e-9):
                raise ValueError(
                    f"{name} must be in [{low:.3f}, {high:.3f}] rad; got {float(angle):.3f}"
                )


def make_joints() -> tuple[Joint, ...]:
    """List the joints of a person, parents first.

    Source:
        From memory: American Academy of Orthopaedic Surgeons (1965) for trunk, arms and legs; the
        Electronic Textbook of Hand Surgery for the hand (MCP 45/90, PIP 0/100, DIP 0/80, thumb
        10/55 and 15/80 degrees). Two joints share the spine's range, two the neck's; clavicle and
        shoulder share the raising of the arm.
    """
    joints = [
        _trunk("pelvis", None, flexion=(-40, 40), bending=(-30, 30), twist=(-180, 180)),
        _trunk("spine", "pelvis", flexion=(-15, 45), bending=(-20, 20), twist=(-20, 20)),
        _trunk("chest", "spine", flexion=(-10, 35), bending=(-15, 15), twist=(-25, 25)),
        _trunk("neck", "chest", flexion=(-25, 25), bending=(-25, 25), twist=(-35, 35)),
        _trunk("head", "neck", flexion=(-20, 20), bending=(-20, 20), twist=(-25, 25)),
    ]
    for side, sign in (("left", 1), ("right", -1)):
        joints += _make_limbs(side, sign)
    return tuple(joints)


def _joint(
    name: str,
    parent: str | None,
    *motions: tuple[str, tuple[float, float, float], float, float],
    **rest: float,
) -> Joint:
    """Make a joint of motions: name, axis, and limits [degrees]; `rest` [rad] by name."""
    made = (
        Motion(
            name=key,
            axis=axis,
            low=math.radians(low),
            high=math.radians(high),
            rest=rest.get(key, 0.0),
        )
        for key, axis, low, high in motions
    )
    return Joint(name=name, parent=parent, motions=tuple(made))


def _trunk(name: str, parent: str | None, **motions: tuple[float, float]) -> Joint:
    """Make a joint of the trunk; forward, to the left and towards the left are positive."""
    axes = {"flexion": (1.0, 0.0, 0.0), "bending": (0.0, 1.0, 0.0), "twist": (0.0, 0.0, 1.0)}
    return _joint(name, parent, *((key, axes[key], *limits) for key, limits in motions.items()))


def _make_limbs(side: str, sign: int) -> list[Joint]:
    forward, outward = (-1.0, 0.0, 0.0), (0.0, -1.0 * sign, 0.0)
    palmward, inward = (0.0, 1.0 * sign, 0.0), (0.0, 0.0, -1.0 * sign)
    backward = (1.0, 0.0, 0.0)
    joints = [
        _joint(
            f"{side}_clavicle", "chest",
            ("elevation", outward, -5, 40), ("protraction", inward, -20, 20),
        ),
        _joint(
            f"{side}_shoulder", f"{side}_clavicle",
            ("flexion", forward, -60, 180), ("abduction", outward, -10, 150),
            ("rotation", inward, -90, 70), abduction=REST_ABDUCTION,
        ),
        _joint(
            f"{side}_elbow", f"{side}_shoulder",
            ("flexion", forward, 0, 145), ("pronation", inward, -85, 90),
        ),
        _joint(
            f"{side}_wrist", f"{side}_elbow",
            ("flexion", palmward, -70, 75), ("deviation", forward, -35, 20),
        ),
    ]  # fmt: skip
    for finger in FINGERS:
        is_thumb = finger == "thumb"
        limits = ((-15, 45), (-10, 55), (-15, 80)) if is_thumb else ((-45, 90), (0, 100), (0, 80))
        spread = ("spread", forward, -20, 45 if is_thumb else 20)
        for k, (low, high) in enumerate(limits, start=1):
            parent = f"{side}_wrist" if k == 1 else f"{side}_{finger}{k - 1}"
            motions = [("flexion", palmward, low, high), *([spread] if k == 1 else [])]
            joints.append(_joint(f"{side}_{finger}{k}", parent, *motions))
    return [
        *joints,
        _joint(
            f"{side}_hip", "pelvis",
            ("flexion", forward, -30, 120), ("abduction", outward, -30, 45),
            ("rotation", inward, -45, 45),
        ),
        _joint(f"{side}_knee", f"{side}_hip", ("flexion", backward, 0, 135)),
        _joint(f"{side}_ankle", f"{side}_knee", ("flexion", forward, -50, 20)),
        _joint(f"{side}_toes", f"{side}_ankle", ("flexion", forward, -40, 70)),
    ]  # fmt: skip
