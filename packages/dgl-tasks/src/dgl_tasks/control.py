"""Arm motion: straight lines, joint-speed limits and inverse kinematics.

Poses are arrays of seven numbers, xyz [m] then wxyz, of the arm's `ee` frame in the world: x along
the fingers, y out of the palm. Nothing here needs a simulator.
"""

import numpy as np
import placo
from scipy.spatial.transform import Rotation, Slerp

from dgl_assets.robots import DEFAULT_ROBOT, BasePlacement, Robot, Side
from dgl_assets.robots.urdf import make_urdf_text
from dgl_tasks.errors import UnreachableError
from dgl_tasks.observation import CONTROL_FREQUENCY, STEPS_PER_ACTION
from dgl_tasks.rotations import to_quaternion, to_rotation

ANGULAR_SPACING = 0.04
"""Largest rotation between samples of a line [rad]."""


def interpolate_action(start: np.ndarray, action: np.ndarray) -> np.ndarray:
    """Reach joint targets in a straight line within the control steps of one action.

    Demonstrations move like this: they have targets at every control step and record every fifth.

    Args:
        start: Targets so far [rad], shape (D,).
        action: Targets that hold at the end [rad], shape (D,).

    Returns:
        Targets of each control step [rad], shape (5, D).
    """
    share = np.arange(1, STEPS_PER_ACTION + 1)[:, None] / STEPS_PER_ACTION
    return (1 - share) * np.asarray(start)[None] + share * np.asarray(action)[None]


def get_joint_limits(robot: Robot) -> np.ndarray:
    """Give the lower and the upper limit of each joint [rad or m], shape (2, D)."""
    joints = (*robot.arm_joints, *robot.hand_joints) * 2
    return np.array([[j.lower for j in joints], [j.upper for j in joints]], dtype=np.float32)


def plan_line(
    start_pose: np.ndarray, goal_pose: np.ndarray, *, spacing: float = 0.01
) -> np.ndarray:
    """Sample the straight line between two poses, orientation by spherical interpolation.

    Args:
        start_pose: xyz [m] and wxyz, shape (7,).
        goal_pose: Likewise.
        spacing: Largest distance between samples [m].

    Returns:
        Poses after the start, up to the goal itself, shape (N, 7). Empty when start and goal agree
        to 1e-9.
    """
    start, goal = _checked_pose("start_pose", start_pose), _checked_pose("goal_pose", goal_pose)
    if spacing <= 0:
        raise ValueError(f"spacing must be positive; got {spacing}")
    distance = float(np.linalg.norm(goal[:3] - start[:3]))
    ends = Rotation.concatenate([to_rotation(start[3:]), to_rotation(goal[3:])])
    angle = float((ends[0].inv() * ends[1]).magnitude())
    if distance < 1e-9 and angle < 1e-9:
        return np.zeros((0, 7))
    # The small allowance keeps 0.30 / 0.01 at 30 samples in spite of rounding.
    count = max(1, int(np.ceil(max(distance / spacing, angle / ANGULAR_SPACING) - 1e-6)))
    fractions = np.arange(1, count + 1) / count
    positions = start[:3] + fractions[:, None] * (goal[:3] - start[:3])
    rotations = to_quaternion(Slerp([0.0, 1.0], ends)(fractions))
    return np.hstack([positions, rotations])


def limit_joint_speed(path: np.ndarray, start_q: np.ndarray, limits: np.ndarray) -> np.ndarray:
    """Slow a joint path down where it would exceed the joints' speeds.

    Args:
        path: Joint positions [rad], one row per control step, shape (N, n).
        start_q: Joint positions before the first row [rad], shape (n,).
        limits: Largest joint speeds [rad/s], shape (n,).

    Returns:
        The same path with joint-space samples inserted, shape (M, n), M >= N; it ends where `path`
        ends.
    """
    rows, previous, dt = [], np.asarray(start_q, dtype=float), 1.0 / CONTROL_FREQUENCY
    for q in np.asarray(path, dtype=float):
        count = max(1, int(np.ceil(np.max(np.abs(q - previous) / (limits * dt)) - 1e-9)))
        rows.extend(previous + (q - previous) * (k / count) for k in range(1, count + 1))
        previous = q
    return np.array(rows).reshape(-1, len(previous))


def _checked_pose(name: str, pose: np.ndarray) -> np.ndarray:
    pose = np.array(pose, dtype=float)
    if pose.shape != (7,):
        raise ValueError(f"{name} must have shape (7,), xyz and wxyz; got {pose.shape}")
    pose[3:] = to_quaternion(to_rotation(pose[3:]))
    return pose


class ArmKinematics:
    """Forward and inverse kinematics of one arm: each call depends on its arguments alone.

    Solutions are found by descent from the given start, so they stay on its branch: shoulder,
    elbow and wrist keep their side. From home, the elbow is above the line from shoulder to wrist.

    Limitations: no collision checks. A pose that only another branch reaches is unreachable.
    """

    POSITION_TOLERANCE = 1e-4
    """Accepted position error [m]."""
    ANGLE_TOLERANCE = 1e-3
    """Accepted orientation error [rad]."""
    _MAX_ITERATIONS = 120
    _MAX_ITERATION_STEP = 0.2  # rad; larger Newton steps overshoot onto other branches
    _DAMPING = 1e-6

    def __init__(self, side: Side, base: BasePlacement, *, robot: Robot = DEFAULT_ROBOT) -> None:
        """Build the solver.

        Args:
            side: "left" or "right".
            base: Base placement: x, y, z [m] and yaw [rad], world frame.
            robot: Whose arm it is; n is its number of joints.
        """
        self.side: Side = side
        self.home: np.ndarray = robot.arm.home[side]
        self._names = robot.joint_names[robot.joint_slice(side, "arm")]
        self._speeds = np.array([joint.speed for joint in robot.arm_joints])
        self._frame = f"{side}_ee"
        tree = robot.build_side_tree(side, base, with_hand=False)
        urdf = make_urdf_text(f"{side}_{robot.arm.name}", tree, None)
        self._robot = placo.RobotWrapper("", placo.Flags.ignore_collisions, urdf)
        assert tuple(self._robot.joint_names()) == self._names
        self._solver = placo.KinematicsSolver(self._robot)
        self._solver.mask_fbase(True)
        self._solver.enable_joint_limits(True)
        self._task = self._solver.add_frame_task(self._frame, np.eye(4))
        self._task.configure(self._frame, "soft", 1.0, 1.0)
        self._solver.add_regularization_task(self._DAMPING)

    def compute_pose(self, q: np.ndarray) -> np.ndarray:
        """Compute the pose of `ee`, shape (7,), at joint positions `q` [rad], shape (n,)."""
        self._set(q)
        T = self._robot.get_T_world_frame(self._frame)
        return np.concatenate([T[:3, 3], to_quaternion(Rotation.from_matrix(T[:3, :3]))])

    def solve(
        self,
        position: np.ndarray,
        quaternion: np.ndarray,
        start_q: np.ndarray,
        *,
        max_step: float | None = None,
    ) -> np.ndarray:
        """Find the joint positions that bring `ee` to a pose, near a start.

        Args:
            position: Wanted position of `ee` [m], shape (3,), world frame.
            quaternion: Wanted orientation, wxyz, shape (4,).
            start_q: Joint positions to start from [rad], shape (n,).
            max_step: Largest accepted change of any joint from the start [rad]; None accepts any.

        Returns:
            Joint positions [rad], shape (n,), within limits, accurate to `POSITION_TOLERANCE` and
            `ANGLE_TOLERANCE`.

        Raises:
            UnreachableError: If there is no such configuration on the start's branch.
        """
        T = np.eye(4)
        T[:3, :3] = to_rotation(quaternion).as_matrix()
        T[:3, 3] = position
        self._task.T_world_frame = T
        start = np.array(start_q, dtype=float)
        q, best = start.copy(), (np.inf, np.inf)
        self._set(q)
        for _ in range(self._MAX_ITERATIONS):
            self._solver.solve(True)
            step = np.array(self._robot.state.q[7:]) - q
            q = q + step * min(1.0, self._MAX_ITERATION_STEP / max(1e-12, np.abs(step).max()))
            self._set(q)
            error = self._error(T)
            best = min(best, error)
            if error[0] < self.POSITION_TOLERANCE and error[1] < self.ANGLE_TOLERANCE:
                self._check_step(q - start, max_step)
                return q
            if np.abs(step).max() < 1e-9:
                break
        raise UnreachableError(
            f"{self.side} arm cannot reach {np.round(np.asarray(position), 3).tolist()}: "
            f"{best[0] * 1000:.1f} mm and {np.degrees(best[1]):.1f} degrees away"
        )

    def follow(
        self,
        waypoints: np.ndarray,
        start_q: np.ndarray,
        *,
        max_step: float = 0.6,
        skips: bool = False,
    ) -> np.ndarray:
        """Turn a line of poses into joint targets, one per control step, within speed limits.

        Args:
            waypoints: Poses of `ee`, shape (N, 7), as made by `plan_line`.
            start_q: Present joint positions [rad], shape (n,).
            max_step: Largest accepted joint change between waypoints [rad]; a larger one is a
                jump to another branch.
            skips: Stay where a waypoint cannot be reached, until the next one that can.

        Returns:
            Joint targets [rad], shape (M, n), M >= N.

        Raises:
            UnreachableError: At the first waypoint that cannot be reached without a jump.
        """
        path, q = [], np.array(start_q, dtype=float)
        for pose in waypoints:
            try:
                q = self.solve(pose[:3], pose[3:], q, max_step=max_step)
            except UnreachableError:
                if not skips:
                    raise
            path.append(q)
        rows = np.array(path).reshape(-1, len(self._names))
        return limit_joint_speed(rows, start_q, self._speeds)

    def _set(self, q: np.ndarray) -> None:
        self._robot.state.q[7:] = q
        self._robot.update_kinematics()

    def _error(self, T_goal: np.ndarray) -> tuple[float, float]:
        T = self._robot.get_T_world_frame(self._frame)
        cosine = (np.sum(T[:3, :3] * T_goal[:3, :3]) - 1) / 2
        return (
            float(np.linalg.norm(T[:3, 3] - T_goal[:3, 3])),
            float(np.arccos(np.clip(cosine, -1.0, 1.0))),
        )

    def _check_step(self, change: np.ndarray, max_step: float | None) -> None:
        largest = int(np.abs(change).argmax())
        if max_step is not None and abs(change[largest]) > max_step:
            joint = self._names[largest].partition("_")[2]
            raise UnreachableError(
                f"{self.side} arm would jump: {joint} by {abs(change[largest]):.2f} rad in one "
                f"step (at most {max_step})"
            )
