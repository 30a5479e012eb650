"""Joints of a person, their motions and limits, and where they are after rotating."""

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
    """One rotation of a joint.

    Attributes:
        name: Such as "flexion".
        axis: Unit axis while the person stands with hanging arms, palms inward, person frame, shape (3,).
        low: Smallest angle [rad]; 0 is standing with hanging arms.
        high: Largest angle [rad].
        rest: Angle in the rest pose [rad].
    """

    name: str
    axis: tuple[float, float, float]
    low: float
    high: float
    rest: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Joint:
    """A joint, and the bone that it moves.

    Attributes:
        name: Such as "left_elbow".
        parent: Name of the joint whose bone it is on; None for the pelvis.
        motions: Applied to the bone last to first: the first turns the axes of those after it.
    """

    name: str
    parent: str | None
    motions: tuple[Motion, ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class Skeleton:
    """Joints with their places in the rest pose.

    Attributes:
        joints: Parents before children.
        positions: Places in the rest pose [m], shape (J, 3), person frame.
        frames: Rotations that take axes from hanging arms to the rest pose, shape (J, 3, 3).
    """

    joints: tuple[Joint, ...]
    positions: np.ndarray
    frames: np.ndarray

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
        """Compute how each bone moves from the rest pose.

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
        Limits are usual ranges of motion: American Academy of Orthopaedic Surgeons (1965) for trunk, arms and legs, from
        memory; of the hand, the reference values of the Electronic Textbook of Hand Surgery (MCP 45/90, PIP 0/100,
        DIP 0/80, thumb 10/55 and 15/80 degrees). The spine's range is shared by two joints, the neck's by two, and
        raising the arm is shared by clavicle and shoulder.
    """
    joints = [
        _joint("pelvis", None, flexion=(-40, 40), bending=(-30, 30), twist=(-180, 180)),
        _joint("spine", "pelvis", flexion=(-15, 45), bending=(-20, 20), twist=(-20, 20)),
        _joint("chest", "spine", flexion=(-10, 35), bending=(-15, 15), twist=(-25, 25)),
        _joint("neck", "chest", flexion=(-25, 25), bending=(-25, 25), twist=(-35, 35)),
        _joint("head", "neck", flexion=(-20, 20), bending=(-20, 20), twist=(-25, 25)),
    ]
    for side, sign in (("left", 1), ("right", -1)):
        joints += _make_arm(side, sign)
        joints += _make_leg(side, sign)
    return tuple(joints)


def _joint(name: str, parent: str | None, **motions: tuple[float, float]) -> Joint:
    """A joint of the trunk; forward, to the left and towards the left are positive [degrees]."""
    axes = {"flexion": (1.0, 0.0, 0.0), "bending": (0.0, 1.0, 0.0), "twist": (0.0, 0.0, 1.0)}
    made = tuple(_motion(key, axes[key], *limits) for key, limits in motions.items())
    return Joint(name=name, parent=parent, motions=made)


def _motion(
    name: str, axis: tuple[float, float, float], low: float, high: float, rest: float = 0.0
) -> Motion:
    return Motion(name=name, axis=axis, low=math.radians(low), high=math.radians(high), rest=rest)


def _make_arm(side: str, sign: int) -> list[Joint]:
    forward, outward = (-1.0, 0.0, 0.0), (0.0, -1.0 * sign, 0.0)
    palmward, inward = (0.0, 1.0 * sign, 0.0), (0.0, 0.0, -1.0 * sign)
    joints = [
        Joint(
            name=f"{side}_clavicle",
            parent="chest",
            motions=(
                _motion("elevation", outward, -5, 40),
                _motion("protraction", inward, -20, 20),
            ),
        ),
        Joint(
            name=f"{side}_shoulder",
            parent=f"{side}_clavicle",
            motions=(
                _motion("flexion", forward, -60, 180),
                _motion("abduction", outward, -10, 150, REST_ABDUCTION),
                _motion("rotation", inward, -90, 70),
            ),
        ),
        Joint(
            name=f"{side}_elbow",
            parent=f"{side}_shoulder",
            motions=(_motion("flexion", forward, 0, 145), _motion("pronation", inward, -85, 90)),
        ),
        Joint(
            name=f"{side}_wrist",
            parent=f"{side}_elbow",
            motions=(_motion("flexion", palmward, -70, 75), _motion("deviation", forward, -35, 20)),
        ),
    ]
    for finger in FINGERS:
        limits = (
            ((-15, 45), (-10, 55), (-15, 80))
            if finger == "thumb"
            else (
                (-45, 90),
                (0, 100),
                (0, 80),
            )
        )
        for k, (low, high) in enumerate(limits, start=1):
            motions = [_motion("flexion", palmward, low, high)]
            if k == 1:
                motions.append(_motion("spread", forward, -20, 45 if finger == "thumb" else 20))
            parent = f"{side}_wrist" if k == 1 else f"{side}_{finger}{k - 1}"
            joints.append(Joint(name=f"{side}_{finger}{k}", parent=parent, motions=tuple(motions)))
    return joints


def _make_leg(side: str, sign: int) -> list[Joint]:
    forward, outward = (-1.0, 0.0, 0.0), (0.0, -1.0 * sign, 0.0)
    backward, inward = (1.0, 0.0, 0.0), (0.0, 0.0, -1.0 * sign)
    return [
        Joint(
            name=f"{side}_hip",
            parent="pelvis",
            motions=(
                _motion("flexion", forward, -30, 120),
                _motion("abduction", outward, -30, 45),
                _motion("rotation", inward, -45, 45),
            ),
        ),
        Joint(
            name=f"{side}_knee",
            parent=f"{side}_hip",
            motions=(_motion("flexion", backward, 0, 135),),
        ),
        Joint(
            name=f"{side}_ankle",
            parent=f"{side}_knee",
            motions=(_motion("flexion", forward, -50, 20),),
        ),
        Joint(
            name=f"{side}_toes",
            parent=f"{side}_ankle",
            motions=(_motion("flexion", forward, -40, 70),),
        ),
    ]
