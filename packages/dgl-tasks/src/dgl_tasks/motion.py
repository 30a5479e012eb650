"""Joint targets for both arms and hands: hand poses, straight lines and reaches."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.spatial.transform import Rotation, Slerp

from dgl_assets.robots import DEFAULT_ROBOT, SIDES, BasePlacement, Robot, Side
from dgl_tasks.clearance import Obstacle, RobotSpheres
from dgl_tasks.control import ArmKinematics, plan_line
from dgl_tasks.declaration import Task
from dgl_tasks.errors import UnreachableError
from dgl_tasks.free_way import Waypoint, choose_orientations
from dgl_tasks.grasps import grasp_to_wrist, point_level, wrist_to_grasp
from dgl_tasks.rotations import to_quaternion, to_rotation

HAND_FRAMES = 20
"""Frames of a change of hand pose (original code)."""
_HAND_RAMP = 14  # frames of which the targets move; the rest lets the fingers arrive
RAMP_FRAMES = 8
"""Frames in which a hand on a line speeds up, and in which it slows down."""
JOINT_SPEED = 2.0
"""Speed of the fastest arm joint of a move in joint space [rad/s]; the limit is 2.09."""
CORNER_FRAMES = 13
"""Frames over which the corner at a via point is rounded."""
TURNED_EVERY = 0.1
"""Distance between the points of a way at which the hand's orientation is chosen [m]."""
TURNS: tuple[float, ...] = tuple(
    float(np.radians(a)) for a in (0, 15, -15, 30, -30, 45, -45, 60, -60)
)
"""Inward turns about the vertical, in the order in which they are tried [rad]."""

REACH_STEP = 2.5
"""Largest change of a joint on a reach [rad]."""
UPRIGHT_STEP = 3.5
"""The same for a hand with the thumb up or down, whose wrist turns half around [rad]."""
ENTERED_MOST = 0.04
"""Depth to which arm, wrist and palm may enter an obstacle on a planned way [m]: palms that press a
garment between them have their targets inside it. Fingers give way."""
CHECKED_EVERY = 5
"""Control steps between two checks of a way against obstacles."""

Rehearsal = Callable[[Side, float], object]
"""Plans one hand's motion, turned inward about the vertical [rad]; raises `UnreachableError`."""

SHIFT_SHARES = (1.0, 0.7, 0.4, 0.0)
"""Shares of a shift that are tried until one is within reach."""
MOST_SHIFTED = 0.8
"""Largest change of a joint by a shift [rad]."""


class BimanualMotion:
    """Turns goals of the hands into rows of D joint targets (60 by default), one per control step.

    It keeps the last targets, from which the next motion starts. It knows kinematics only: the
    caller sends the rows to the environment. Ways through obstacles are refused, except for parking
    and for the samples that `follow` may leave out.
    """

    def __init__(self, task: Task, *, robot: Robot = DEFAULT_ROBOT) -> None:
        """Prepare both arms of a task.

        Args:
            task: Says where the bases stand.
            robot: Whose arms and hands they are.
        """
        bases: dict[Side, BasePlacement] = {"left": task.left_base, "right": task.right_base}
        self.robot = robot
        self.obstacles: Sequence[Obstacle] = ()
        """Objects that arms and hands keep out of, where they stand in this episode."""
        self._arms = {side: ArmKinematics(side, bases[side], robot=robot) for side in SIDES}
        self._spheres = RobotSpheres(robot, bases)
        self.target = np.zeros(robot.dof)

    def reset(self, joint_state: np.ndarray) -> None:
        """Start from these joint positions [rad], shape (D,)."""
        self.target = np.array(joint_state, dtype=float)

    def compute_poses(self) -> dict[Side, np.ndarray]:
        """Compute the pose of each `ee` at the last targets: xyz [m] and wxyz, shape (7,)."""
        return {side: self._arms[side].compute_pose(self._get_joints(side)) for side in SIDES}

    def hold(self, frames: int) -> np.ndarray:
        """Keep the targets, shape (frames, D)."""
        return np.tile(self.target, (frames, 1))

    def set_hands(self, poses: Mapping[Side, str]) -> np.ndarray:
        """Bring hands to named poses of `HAND_POSES`, shape (20, D)."""
        rows = self.hold(HAND_FRAMES)
        ramp = np.clip(np.arange(1, HAND_FRAMES + 1) / _HAND_RAMP, 0, 1)[:, None]
        for side, name in poses.items():
            part = self.robot.joint_slice(side, "hand")
            rows[:, part] += ramp * (self.robot.get_hand_pose(name) - self.target[part])
        return self._finish(rows)

    def move(
        self,
        points: Mapping[Side, np.ndarray],
        orientations: Mapping[Side, np.ndarray],
        *,
        spacing: float = 0.01,
    ) -> np.ndarray:
        """Move grasp points on straight lines, both hands leaving and arriving together, at rest.

        Args:
            points: Goal of the grasp point of each moving hand [m], shape (3,), world frame.
            orientations: Orientation of each moving hand at the goal, wxyz, shape (4,).
            spacing: Distance between samples of the longer line [m]; 0.01 is 0.6 m/s.

        Returns:
            Joint targets [rad], shape (N, D).

        Raises:
            UnreachableError: If a hand cannot follow its line.
        """
        lines = {}
        for side, point in points.items():
            q = orientations[side]
            wrist = grasp_to_wrist(np.asarray(point), q, side, robot=self.robot)
            start = self._arms[side].compute_pose(self._get_joints(side))
            lines[side] = (start, np.concatenate([wrist, q]))
        count = max((len(plan_line(*line, spacing=spacing)) for line in lines.values()), default=0)
        if count == 0:
            return np.zeros((0, self.robot.dof))
        paths = {}
        for side, (start, goal) in lines.items():
            length = float(np.linalg.norm(goal[:3] - start[:3]))
            waypoints = plan_line(start, goal, spacing=max(length / count, 1e-6))
            paths[side] = self._arms[side].follow(waypoints, self._get_joints(side))
        rows = self.hold(max(len(path) for path in paths.values()))
        for side, path in paths.items():
            if len(path):
                # stretched over the longer path, so that both arrive together
                at = np.linspace(0, len(path) - 1, len(rows))
                rows[:, self.robot.joint_slice(side, "arm")] = _resample(path, at)
        self._check_clear(lines, rows)
        return self._finish(_ramp(np.concatenate([self.target[None], rows])))

    def follow(
        self,
        points: Mapping[Side, np.ndarray],
        orientations: Mapping[Side, np.ndarray],
        hands: Mapping[Side, np.ndarray],
        *,
        must_reach: bool = True,
    ) -> np.ndarray:
        """Follow ways of one sample a control step, slower where the arms are too slow for them.

        Args:
            points: Grasp point of each moving hand [m], shape (N, 3), world frame.
            orientations: Of `ee` of each of these hands, wxyz, shape (N, 4).
            hands: Joint positions of each of these hands [rad], shape (N, H).
            must_reach: Refuse samples out of reach; otherwise the arm waits for the next one within
                reach.

        Returns:
            Joint targets [rad], shape (M, D), M >= N.

        Raises:
            UnreachableError: If a hand cannot follow its way.
        """
        paths: dict[Side, np.ndarray] = {}
        for side, way in points.items():
            present = self.target[self.robot.joint_slice(side, "arm")]
            poses = [
                np.concatenate([grasp_to_wrist(point, q, side, robot=self.robot), q])
                for point, q in zip(way, orientations[side], strict=True)
            ]
            paths[side] = self._arms[side].follow(np.stack(poses), present, skips=not must_reach)
        count = max(len(path) for path in paths.values())
        rows = self.hold(count)
        at = np.linspace(0, 1, count)
        for side, path in paths.items():
            for part, way in (("arm", path), ("hand", hands[side])):
                columns = self.robot.joint_slice(side, part)
                share = np.linspace(0, 1, len(way))
                rows[:, columns] = np.stack([np.interp(at, share, c) for c in way.T], axis=1)
        if must_reach:
            self._check_clear(paths, rows)
        return self._finish(rows)

    def pass_through(
        self,
        points: Mapping[Side, np.ndarray],
        *,
        spacing: float = 0.01,
        towards: np.ndarray | None = None,
    ) -> tuple[np.ndarray, dict[Side, np.ndarray]]:
        """Move grasp points through via points without a stop; the hands turn as the arms need.

        The palms look down. All hands pass their via points of one number together.

        Args:
            points: Via points and goal of each moving hand [m], shape (K, 3), world frame.
            spacing: As of `move`.
            towards: Point that the fingers point at where the arms allow it [m], shape (3,).

        Returns:
            Joint targets [rad], shape (N, D), and the orientation of each hand at the end, wxyz.

        Raises:
            UnreachableError: If a hand has no way within reach that keeps out of obstacles.
        """
        poses = self.compute_poses()
        corners: dict[Side, np.ndarray] = {}
        for side, via in points.items():
            pose = poses[side]
            begin = wrist_to_grasp(pose[:3], pose[3:], side, robot=self.robot)
            corners[side] = np.concatenate([begin[None], via])
        lengths = np.max([np.linalg.norm(np.diff(c, axis=0), axis=1) for c in corners.values()], 0)
        times = np.concatenate([[0.0], np.cumsum(lengths / spacing)])
        if times[-1] < 1e-9:
            return np.zeros((0, self.robot.dof)), {side: poses[side][3:] for side in points}
        at = np.linspace(0.0, times[-1], 1 + max(1, int(np.ceil(times[-1]))))
        parts = min(len(at) - 1, max(1, round(lengths.sum() / TURNED_EVERY)))
        turned = np.linspace(0, len(at) - 1, parts + 1).round().astype(int)
        places, turns, ends = {}, {}, {}
        for side, line in corners.items():
            place = np.stack([np.interp(at, times, axis) for axis in line.T], axis=1)
            # the ends stay where they are
            place[1:-1] = uniform_filter1d(place, CORNER_FRAMES, axis=0, mode="nearest")[1:-1]
            start = Waypoint(joints=self._get_joints(side), quaternion=poses[side][3:])
            chosen = choose_orientations(
                self._arms[side],
                self.robot,
                np.split(place[1:], turned[1:-1]),
                start,
                is_clear=lambda joints, side=side: self._is_clear(side, joints),
                towards=towards,
            )
            stops = Rotation.concatenate([to_rotation(w.quaternion) for w in (start, *chosen)])
            places[side] = place[1:]
            turns[side] = to_quaternion(Slerp(turned, stops)(np.arange(1, len(at))))
            ends[side] = chosen[-1].quaternion
        before = self.target.copy()
        hands: dict[Side, np.ndarray] = {
            side: np.tile(before[self.robot.joint_slice(side, "hand")], (len(at) - 1, 1))
            for side in points
        }
        rows = self.follow(places, turns, hands)
        return self._finish(_ramp(np.concatenate([before[None], rows]))), ends

    def shift(
        self, row: np.ndarray, shifts: Mapping[Side, float], *, towards: np.ndarray
    ) -> tuple[np.ndarray, dict[Side, float]]:
        """Shift the hands of a planned sample level towards a place, as far as the arms reach.

        Args:
            row: Joint targets [rad], shape (D,).
            shifts: Of each hand [m].
            towards: The place [m], shape (3,), world frame.

        Returns:
            Joint targets [rad], shape (D,), and the shifts that were reached.
        """
        row, reached = row.copy(), {}
        for side, wanted in shifts.items():
            arm, part = self._arms[side], self.robot.joint_slice(side, "arm")
            pose = arm.compute_pose(row[part])
            grasp = wrist_to_grasp(pose[:3], pose[3:], side, robot=self.robot)
            way = point_level(grasp, towards)
            for share in SHIFT_SHARES:
                reached[side] = share * wanted
                try:
                    row[part] = arm.solve(
                        pose[:3] + reached[side] * way, pose[3:], row[part], max_step=MOST_SHIFTED
                    )
                    break
                except UnreachableError:
                    continue
        return self._finish(row[None])[0], reached

    def _is_clear(self, side: Side, joints: np.ndarray) -> bool:
        row = self.target.copy()
        row[self.robot.joint_slice(side, "arm")] = joints
        return self._spheres.find_touched(side, row[None], self.obstacles) is None

    def reach(
        self, points: Mapping[Side, np.ndarray], orientations: Mapping[Side, np.ndarray]
    ) -> np.ndarray:
        """Bring grasp points to goals through free space, straight in joint space, shape (N, D).

        Raises:
            UnreachableError: If a goal has no joint configuration near the present one or home, or
                an obstacle is in the way.
        """
        goals = {}
        for side, point in points.items():
            q, arm = orientations[side], self._arms[side]
            is_upright = abs(to_rotation(q).apply([0.0, 0.0, 1.0])[2]) > np.sqrt(0.5)
            most = UPRIGHT_STEP if is_upright else REACH_STEP
            wrist = grasp_to_wrist(np.asarray(point), q, side, robot=self.robot)
            try:
                goals[side] = arm.solve(wrist, q, arm.home, max_step=most)
            except UnreachableError:
                goals[side] = arm.solve(wrist, q, self._get_joints(side), max_step=most)
        with self.rehearsal():
            self._check_clear(goals, self.move_joints(goals))
        return self.move_joints(goals)

    def park(self) -> np.ndarray:
        """Move both arms out of the cameras' view of the garment, shape (N, D)."""
        return self.move_joints(self.robot.arm.parked)

    def choose_turns(self, sides: tuple[Side, ...], *rehearsals: Rehearsal) -> dict[Side, float]:
        """Choose each hand's smallest inward turn about the vertical [rad] that makes it reach.

        Args:
            sides: Working hands.
            rehearsals: Motions in order of preference: the next one is tried when no turn makes the
                one before reachable. Targets are restored afterwards.

        Raises:
            UnreachableError: If no turn makes the last one reachable; with the message of no turn.
        """
        return {side: self._choose_turn(side, rehearsals) for side in sides}

    def _choose_turn(self, side: Side, rehearsals: tuple[Rehearsal, ...]) -> float:
        first: UnreachableError | None = None
        for rehearse in rehearsals:
            first = None
            for turn in TURNS:
                try:
                    with self.rehearsal():
                        rehearse(side, turn)
                except UnreachableError as err:
                    first = first or err
                else:
                    return turn
        assert first is not None
        raise first

    @contextmanager
    def rehearsal(self) -> Iterator[None]:
        """Plan without consequences: the end of the block restores the targets."""
        target = self.target.copy()
        try:
            yield
        finally:
            self.target = target

    def move_joints(self, sides: Mapping[Side, np.ndarray]) -> np.ndarray:
        """Move arms straight in joint space, shape (N, D).

        Args:
            sides: Goal of each moving arm [rad], shape (n,).
        """
        goal = self.target.copy()
        for side, q in sides.items():
            goal[self.robot.joint_slice(side, "arm")] = q
        change = goal - self.target
        # a fifth of the time to speed up and a fifth to slow down: the peak is 1.25 times the mean
        frames = int(np.ceil(1.25 * np.abs(change).max() / JOINT_SPEED * 60))
        if frames == 0:
            return np.zeros((0, self.robot.dof))
        s = np.arange(1, frames + 1) / frames
        ramp = 1.25 * np.where(
            s < 0.2, 2.5 * s**2, np.where(s > 0.8, 0.8 - 2.5 * (1 - s) ** 2, s - 0.1)
        )
        return self._finish(self.target + change * ramp[:, None])

    def _check_clear(self, sides: Iterable[Side], rows: np.ndarray) -> None:
        """Refuse a way on which an arm or hand enters an obstacle."""
        for side in sides if self.obstacles else ():
            checked = rows[CHECKED_EVERY - 1 :: CHECKED_EVERY]
            touched = self._spheres.find_touched(side, checked, self.obstacles, with_fingers=False)
            if touched is not None and touched[1] > ENTERED_MOST:
                name, depth = touched
                raise UnreachableError(f"{side} hand would enter {name} by {depth * 100:.1f} cm")

    def _get_joints(self, side: Side) -> np.ndarray:
        return self.target[self.robot.joint_slice(side, "arm")]

    def _finish(self, rows: np.ndarray) -> np.ndarray:
        self.target = rows[-1].copy()
        return rows


def _ramp(path: np.ndarray) -> np.ndarray:
    """Follow a path of one sample a frame so that it begins and ends at rest.

    Args:
        path: Joint positions [rad], shape (N + 1, D), the present ones first.

    Returns:
        Joint targets [rad], shape (N + R, D), with R the frames of a ramp, at most N / 2.
    """
    count = len(path) - 1
    ramp = min(RAMP_FRAMES, count // 2)
    if ramp == 0:
        return path[1:]
    t = np.arange(1, count + ramp + 1, dtype=float)
    left = count + ramp - t
    way = np.where(t < ramp, t**2 / (2 * ramp), t - ramp / 2)
    way = np.where(left < ramp, count - left**2 / (2 * ramp), way)
    return _resample(path, way)


def _resample(path: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Interpolate the rows of a path, shape (N, D), at real row numbers, shape (M,)."""
    rows = np.arange(len(path))
    return np.stack([np.interp(at, rows, column) for column in path.T], axis=1)
