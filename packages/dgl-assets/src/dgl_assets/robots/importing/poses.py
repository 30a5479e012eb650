"""Six poses of an imported hand, by the fingertip positions of the Shadow Hand's poses."""

from collections.abc import Mapping

import numpy as np
from scipy.optimize import least_squares

from dgl_assets.robots.hand import HAND_TIPS
from dgl_assets.robots.importing.fingers import Finger, HandFrame, rest_positions
from dgl_assets.robots.robot import SHADOW_HAND_PART
from dgl_assets.robots.tree import KinematicTree

_REFERENCE = ("th", "ff", "mf", "rf", "lf")
_BASES = {"th": "THJ5", "ff": "FFJ4", "mf": "MFJ4", "rf": "RFJ4", "lf": "LFJ4"}
PULL_TO_REST = 0.003
"""Weight that draws a joint to rest where the tip leaves it free [m]."""
THUMB_REACH = 0.3
"""Weight of the thumb's own reach beside its position relative to the first finger."""


def take_over_poses(tree: KinematicTree, frame: HandFrame) -> dict[str, dict[str, float]]:
    """Find the joint values of open, close, pinch, cradle, smooth and flat.

    Each fingertip goes to the position of the Shadow Hand's, relative to the finger's base and
    scaled by the finger's length; the thumb's relative to the first finger's tip. Joints of the
    wrist stay at rest. Fingers are counted from the thumb; a hand with fewer lacks the last ones.

    Limitations: fingers are not kept apart from each other.

    Args:
        tree: The hand, right or left.
        frame: What is known about it.

    Returns:
        Joint values [rad or m] by name, for each pose.
    """
    rest = rest_positions(tree)
    poses = {}
    for name, values in SHADOW_HAND_PART.poses.items():
        reach, thumb_from_first = _measure_reference(values)
        positions = dict(rest)
        thumb, *others = frame.fingers
        for finger, key in zip(others, _REFERENCE[1:], strict=False):
            wanted = reach[key] * (finger.length / _length(key))
            _solve(tree, frame, finger, positions, [(1.0, finger.base, wanted)])
        first = _tip(tree, frame, others[0], positions)
        scale = others[0].length / _length("ff")
        _solve(
            tree,
            frame,
            thumb,
            positions,
            [
                (1.0, frame.rotation @ first, thumb_from_first * scale),
                (THUMB_REACH, thumb.base, reach["th"] * thumb.length / _length("th")),
            ],
        )
        poses[name] = positions
    return poses


def compute_grasp_point(frame: HandFrame, hand_to_ee: np.ndarray) -> tuple[float, float, float]:
    """Find the grasp point between the fingers, relative to them as in the Shadow Hand.

    Args:
        frame: The right hand.
        hand_to_ee: Pose of its first link in `ee`, shape (4, 4).

    Returns:
        Place in axes of `ee` [m].
    """
    bases = [_shadow_base(key) for key in ("ff", "mf")]
    beyond = np.array(SHADOW_HAND_PART.grasp_point) - np.mean(bases, axis=0)
    others = frame.fingers[1:3]
    scale = np.mean([f.length for f in others]) / _length("ff")
    middle = np.mean([hand_to_ee[:3, :3] @ f.base + hand_to_ee[:3, 3] for f in others], axis=0)
    x, y, z = middle + scale * beyond
    return float(x), float(y), float(z)


def _solve(
    tree: KinematicTree,
    frame: HandFrame,
    finger: Finger,
    positions: dict[str, float],
    goals: list[tuple[float, np.ndarray, np.ndarray]],
) -> None:
    """Solve one finger's joints for goals of its tip: weight, origin, and offset from it."""
    tree = tree.take_chain(finger.tip_link)
    joints = {joint.name: joint for joint in tree.joints}
    low = np.array([joints[name].lower for name in finger.joints])
    high = np.array([joints[name].upper for name in finger.joints])
    rest = np.clip(0.0, low, high)

    def residual(q: np.ndarray) -> np.ndarray:
        trial = {**positions, **dict(zip(finger.joints, q.tolist(), strict=True))}
        tip = _tip(tree, frame, finger, trial)
        errors = [w * (tip - frame.rotation.T @ origin - offset) for w, origin, offset in goals]
        pull = PULL_TO_REST * (q - rest) / np.maximum(high - low, 1e-6)
        return np.concatenate([*errors, pull])

    room = 1e-6 * (high - low)
    starts = [
        np.clip(rest + share * ((low + high) / 2 - rest), low + room, high - room)
        for share in (0.1, 1.0)
    ]
    found = [least_squares(residual, q, bounds=(low, high), max_nfev=60) for q in starts]
    best = min(found, key=lambda result: result.cost)
    positions |= dict(zip(finger.joints, best.x.tolist(), strict=True))


def _tip(
    tree: KinematicTree, frame: HandFrame, finger: Finger, positions: Mapping[str, float]
) -> np.ndarray:
    """Fingertip of the hand as a right one [m], axes: fingers, palm, their cross product."""
    T = tree.compute_link_poses(positions)[finger.tip_link]
    return frame.rotation.T @ (T[:3, :3] @ finger.tip + T[:3, 3])


def _shadow_poses(values: np.ndarray) -> dict[str, np.ndarray]:
    tree = SHADOW_HAND_PART.trees["right"]
    positions = dict(zip(tree.moving_joint_names, values.tolist(), strict=True))
    return tree.compute_link_poses(positions | {"WRJ2": 0.0, "WRJ1": 0.0})


def _measure_reference(values: np.ndarray) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Give the Shadow Hand's tips from their bases, the thumb's from the first finger's [m]."""
    poses, R = _shadow_poses(values), SHADOW_HAND_PART.mounts["right"][:3, :3]
    tips = {key: R @ poses[f"{key}_tip"][:3, 3] for key in _REFERENCE}
    bases = {key: R @ poses[_child(key)][:3, 3] for key in _REFERENCE}
    return {key: tips[key] - bases[key] for key in _REFERENCE}, tips["th"] - tips["ff"]


def _shadow_base(key: str) -> np.ndarray:
    M = SHADOW_HAND_PART.mounts["right"]
    poses = _shadow_poses(np.zeros(len(SHADOW_HAND_PART.gains)))
    return M[:3, :3] @ poses[_child(key)][:3, 3] + M[:3, 3]


def _child(key: str) -> str:
    joints = SHADOW_HAND_PART.trees["right"].joints
    return next(joint.child for joint in joints if joint.name == _BASES[key])


def _length(key: str) -> float:
    """Length of a Shadow finger from its base to its tip [m]."""
    thumb = 0.038 + 0.032 + HAND_TIPS["th_tip"][1]
    return thumb if key == "th" else 0.045 + 0.025 + HAND_TIPS["ff_tip"][1]
