"""Home configuration of an imported arm: inverse kinematics from many starts, in numpy."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from dgl_assets.robots._frames import rotation_about, transform
from dgl_assets.robots.errors import RobotImportError
from dgl_assets.robots.robot import PARK_ANGLE, UR10E_ARM
from dgl_assets.robots.tree import EE_LINK, KinematicTree, Side

STARTS = 60
STEPS = 60
POSITION_TOLERANCE, ANGLE_TOLERANCE = 1e-5, 1e-4
"""Accepted errors [m] and [rad]."""
CANDIDATES = 8
"""Solutions that are tried."""
FORWARD_PALM_DOWN = np.array([[0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
"""Axes of `ee` at home, as columns: fingers towards +y, palm towards -z."""
PLACES = (
    (0.1, 0.5, -0.1),
    (0.35, 0.7, -0.15),
    (0.6, 0.65, -0.15),
    (0.35, 0.4, -0.35),
    (0.35, 0.8, -0.35),
    (0.1, 0.75, 0.25),
    (0.6, 0.5, -0.35),
)
"""Grasp point of garments from the left base [m], for an arm as long as the UR10e."""
TURNS = (0.0, 0.35, 0.7)
"""Angle by which the hand points inwards there [rad]."""
MARGIN = 0.05
"""Distance that home keeps from the joints' limits, a share of their range."""


@dataclass(frozen=True, kw_only=True)
class Home:
    """Home configuration of an arm, and its score."""

    positions: np.ndarray
    """Joint positions [rad or m], shape (n,)."""
    score: float
    """Number of probes that are reached from it, and its rating, which is below one."""


def find_home(tree: KinematicTree, side: Side) -> Home | None:
    """Find joint positions with the fingers forward and the palm down, where the UR10e has them.

    The hand's position is that of the UR10e's home, nearer by the ratio of the arms' lengths, or
    further on the same line. Arms stay on the branch that they start on: of the solutions with the
    highest elbows and best-conditioned Jacobians, the one that reaches most is taken.

    Args:
        tree: The arm, up to `ee`.
        side: Which side.

    Returns:
        The best found, or None.
    """
    chain = ArmChain(tree)
    reference = ArmChain(UR10E_ARM.tree).linearise(UR10E_ARM.home[side])[0]
    ratio = compute_reach(tree) / compute_reach(UR10E_ARM.tree)
    for stretch in (ratio, 0.8 * ratio, 1.2 * ratio, 1.0):
        goal = transform(stretch * reference[:3, 3], FORWARD_PALM_DOWN)
        found = _search(chain, goal)
        if not found:
            continue
        probes = list(_make_probes(goal, side, stretch))
        homes = [
            Home(
                positions=q,
                score=chain.rate(q) + sum(chain.solve(probe, q) is not None for probe in probes),
            )
            for q in found
        ]
        return max(homes, key=lambda home: home.score)
    return None


def _make_probes(goal: np.ndarray, side: Side, stretch: float) -> Iterator[np.ndarray]:
    """List poses of `ee` that an arm should reach from home, turned as grasps are."""
    inward = 1.0 if side == "left" else -1.0
    for place in PLACES:
        for turn in TURNS:
            probe = goal.copy()
            probe[:3, :3] = rotation_about(np.array([0.0, 0.0, 1.0]), -inward * turn) @ goal[:3, :3]
            probe[:3, 3] = stretch * np.array(place) * (inward, 1.0, 1.0)
            yield probe


def _search(chain: "ArmChain", goal: np.ndarray) -> list[np.ndarray]:
    """Find solutions from many starts, the best rated first."""
    rng, found = np.random.default_rng(0), []
    for k in range(STARTS):
        start = (chain.low + chain.high) / 2 if k == 0 else rng.uniform(chain.low, chain.high)
        q = chain.solve(goal, start)
        if q is not None and chain.has_margin(q):
            found.append(q)
    return sorted(found, key=chain.rate, reverse=True)[:CANDIDATES]


def find_parked(tree: KinematicTree, home: np.ndarray, side: Side) -> np.ndarray:
    """Swing an arm outwards about the vertical through its base [rad or m], shape (n,).

    Raises:
        RobotImportError: If the arm cannot.
    """
    angle = PARK_ANGLE if side == "left" else -PARK_ANGLE
    chain, q = ArmChain(tree), home
    start = chain.linearise(home)[0]
    for share in np.linspace(0.1, 1.0, 10):
        turn = transform((0, 0, 0), rotation_about(np.array([0.0, 0.0, 1.0]), share * angle))
        solved = chain.solve(turn @ start, q)
        if solved is None:
            raise RobotImportError(f"the {side} arm cannot swing outwards from home; give --home")
        q = solved
    return q


def compute_reach(tree: KinematicTree) -> float:
    """Length of the chain from base to `ee`, joint by joint [m]."""
    joints = tree.take_chain(EE_LINK).joints
    return float(sum(np.linalg.norm(joint.joint_to_parent[:3, 3]) for joint in joints))


class ArmChain:
    """The chain from base to `ee`, prepared for many evaluations."""

    def __init__(self, tree: KinematicTree) -> None:
        """Collect the joints; fixed ones become part of the next one's constant transform."""
        self.low, self.high = _limits(tree)
        self._links: list[tuple[np.ndarray, np.ndarray, np.ndarray, bool]] = []
        T = np.eye(4)
        for joint in tree.take_chain(EE_LINK).joints:
            T = T @ joint.joint_to_parent
            if joint.axis is not None:
                x, y, z = joint.axis
                K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
                self._links.append((T, np.array(joint.axis), K, joint.kind == "prismatic"))
                T = np.eye(4)
        self._end = T

    def linearise(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Compute the pose of `ee`, (4, 4), its Jacobian, (6, n), and joint origins [m], (n, 3)."""
        R, p = np.eye(3), np.zeros(3)
        axes, places = np.empty((len(q), 3)), np.empty((len(q), 3))
        for k, ((T, axis, K, slides), value) in enumerate(zip(self._links, q, strict=True)):
            p, R = p + R @ T[:3, 3], R @ T[:3, :3]
            axes[k], places[k] = R @ axis, p
            if slides:
                p = p + axes[k] * value
            else:
                R = R @ (np.eye(3) + np.sin(value) * K + (1.0 - np.cos(value)) * (K @ K))
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = R @ self._end[:3, :3], p + R @ self._end[:3, 3]
        slides = np.array([link[3] for link in self._links])[:, None]
        linear = np.where(slides, axes, np.cross(axes, pose[:3, 3] - places))
        return pose, np.hstack([linear, np.where(slides, 0.0, axes)]).T, places

    def solve(self, goal: np.ndarray, start: np.ndarray) -> np.ndarray | None:
        """Find joint positions that bring `ee` to a pose by damped steps; None if that fails.

        Args:
            goal: Pose of `ee` in the frame of the base, shape (4, 4).
            start: Joint positions [rad or m], shape (n,).
        """
        q, damping = np.clip(start, self.low, self.high), 1e-3
        pose, J, _ = self.linearise(q)
        error = _subtract(goal, pose)
        for _ in range(STEPS):
            is_there = np.linalg.norm(error[:3]) < POSITION_TOLERANCE
            if is_there and np.linalg.norm(error[3:]) < ANGLE_TOLERANCE:
                return q
            step = J.T @ np.linalg.solve(J @ J.T + damping * np.eye(6), error)
            step *= min(1.0, 0.4 / max(1e-12, np.abs(step).max()))
            trial = np.clip(q + step, self.low, self.high)
            pose, new_J, _ = self.linearise(trial)
            new_error = _subtract(goal, pose)
            if np.linalg.norm(new_error) < np.linalg.norm(error):
                q, error, J, damping = trial, new_error, new_J, max(damping / 4, 1e-9)
            else:
                damping *= 8
                if damping > 1e3:
                    return None
        return None

    def has_margin(self, q: np.ndarray) -> bool:
        """Tell whether joints keep their distance from the limits."""
        room = MARGIN * (self.high - self.low)
        return bool(((q >= self.low + room) & (q <= self.high - room)).all())

    def rate(self, q: np.ndarray) -> float:
        """Rate a solution: least singular value, distance to the limits, and height [m]."""
        _, J, places = self.linearise(q)
        room = float((np.minimum(q - self.low, self.high - q) / (self.high - self.low)).min())
        heights = places[:, 2]
        lowest = min(0.0, float(heights.min()))
        return float(np.linalg.svd(J)[1][-1] + room + 0.5 * heights.mean() + lowest)


def _subtract(goal: np.ndarray, pose: np.ndarray) -> np.ndarray:
    """Difference of two poses: metres, and the axis of the turn times its angle, shape (6,)."""
    R = goal[:3, :3] @ pose[:3, :3].T
    sine = np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]]) / 2
    length = float(np.linalg.norm(sine))
    angle = float(np.arctan2(length, (np.trace(R) - 1) / 2))
    turn = sine * (angle / length if length > 1e-9 else 1.0)
    if length <= 1e-9 and angle > 1.0:  # half a turn: any axis will do to get away from it
        turn = np.array([angle, 0.0, 0.0])
    return np.concatenate([goal[:3, 3] - pose[:3, 3], turn])


def _limits(tree: KinematicTree) -> tuple[np.ndarray, np.ndarray]:
    moving = [joint for joint in tree.joints if joint.axis is not None]
    # beyond half a turn the same poses come again
    low = np.array([max(j.lower, -np.pi) if j.kind == "revolute" else j.lower for j in moving])
    high = np.array([min(j.upper, np.pi) if j.kind == "revolute" else j.upper for j in moving])
    return np.minimum(low, high), np.maximum(low, high)
