"""A small synthetic task without a simulator, and episodes of it.

A sheet lies on a table. Two hands, which the first three joints of each arm move along x, y and z,
go to one point of the sheet each, while the fingers close and the fourth joint of each arm turns to
where an object stands. Which points, only the affordance says: neither the environment's cloud nor
its picture shows them.

It is no physics: joints follow their targets with a lag, and nothing is grasped.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

import h5py
import numpy as np

from dgl_files.whole import written_beside
from dgl_sadp._episode_file import FORMAT_VERSION, JOINTS, ROBOT

__all__ = ["SyntheticEnvironment", "SyntheticMatcher", "write_synthetic_episodes"]

_SHEET = np.array([0.8, 0.6])  # Size [m].
_HOMES = np.array([[-0.4, 0.2, 0.5], [0.4, 0.2, 0.5]])  # Hands at joint angles 0 [m].
_ARMS = (slice(0, 3), slice(30, 33))  # Joints that move each hand.
_TURNS = (3, 33)  # Joints that turn to the object.
_FINGERS = (slice(6, 30), slice(36, 60))
_REACH = 0.5  # Movement of a hand [m] for a radian.
_LAG = 0.6  # Share of the way to its target that a joint goes in a frame.
_NEAR = 0.05  # Mean distance of hands that have come to their goals [m].
_WIDTH = 0.1  # Standard deviation of the affordance around its point [m].
_SHARES = (
    0.55,
    0.15,
    0.15,
)  # Of the environment's points: sheet and each hand; the rest is the object's.


@dataclass(frozen=True, kw_only=True, eq=False)
class _Scene:
    """Random draws of an episode."""

    garment: np.ndarray
    """Points of the sheet [m], shape (N, 3), world frame."""
    places: np.ndarray
    """Goals in the sheet's frame, in [-1, 1], shape (2, 2)."""
    goals: np.ndarray
    """Goals of the left and the right hand [m], shape (2, 3), world frame: points of the sheet."""
    object: np.ndarray
    """Points of the object [m], shape (N, 3), world frame."""


class SyntheticEnvironment:
    """One environment of the made-up task.

    Observations have the keys, shapes and units of episode files.
    """

    def __init__(
        self,
        *,
        points: int = 2048,
        frames: int = 24,
        has_object: bool = True,
        image_size: tuple[int, int] = (48, 64),
    ) -> None:
        """Set up; `reset` draws the first scene.

        Args:
            points: Points of each cloud.
            frames: Length of the expert's motion [frames], at least 2; it ends with two frames of
                rest.
            has_object: Whether there is an object.
            image_size: Rows and columns of pictures [pixel].
        """
        if points < 16 or frames < 4:
            raise ValueError(f"points must be >= 16 and frames >= 4; got {points} and {frames}")
        self.points = points
        self.frames = frames
        self.has_object = has_object
        self.image_size = image_size
        self.reset(seed=0)

    def reset(self, *, seed: int, places: np.ndarray | None = None) -> None:
        """Draw a scene, and bring the hands back.

        Args:
            seed: Of what is drawn.
            places: Where on the sheet the hands should go, as `places` of another scene; drawn when
                not given.
        """
        self._rng = np.random.default_rng(seed)
        self._scene = _draw_scene(self._rng, self.points, places)
        self._joints = np.zeros(JOINTS)

    @property
    def goals(self) -> np.ndarray:
        """Points that the left and the right hand should go to [m], shape (2, 3), world frame."""
        return self._scene.goals.copy()

    @property
    def places(self) -> np.ndarray:
        """Points as shares of the sheet's half length and width, in [-1, 1], shape (2, 2)."""
        return self._scene.places.copy()

    @property
    def hands(self) -> np.ndarray:
        """Positions of the hands [m], shape (2, 3), world frame."""
        return np.stack(
            [home + _REACH * self._joints[arm] for home, arm in zip(_HOMES, _ARMS, strict=True)]
        )

    def compute_error(self) -> float:
        """Mean distance of the hands to their goals [m]."""
        return float(np.linalg.norm(self.hands - self.goals, axis=1).mean())

    def make_expert(self) -> np.ndarray:
        """Return the expert's joint targets [rad], shape (frames, 60), of minimum jerk."""
        times = np.clip((np.arange(self.frames) + 1) / (self.frames - 2), 0.0, 1.0)
        share = (10 * times**3 - 15 * times**4 + 6 * times**5)[:, None]
        end = np.zeros(JOINTS)
        for home, goal, arm in zip(_HOMES, self._scene.goals, _ARMS, strict=True):
            end[arm] = (goal - home) / _REACH
        if self.has_object:
            centre = self._scene.object.mean(axis=0)
            end[list(_TURNS)] = np.arctan2(centre[0], centre[1])
        for finger in _FINGERS:
            end[finger] = np.linspace(0.3, 1.2, 24)
        # Wrists (joints 4, 5, 34, 35) stay: a robot has joints that a task does not use.
        return (self._joints + share * (end - self._joints)).astype(np.float32)

    def get_affordance(self) -> np.ndarray:
        """Return the affordance that a perfect matcher would find, in [0, 1], shape (N, 2)."""
        distance = np.linalg.norm(self._scene.garment[:, None] - self._scene.goals[None], axis=2)
        return np.exp(-0.5 * (distance / _WIDTH) ** 2).astype(np.float32)

    def see_stage(self) -> dict[str, np.ndarray]:
        """Return the clouds of sheet and object, which do not change."""
        seen = {"garment_point_cloud": self._scene.garment.astype(np.float32)}
        if self.has_object:
            seen["object_point_cloud"] = self._scene.object.astype(np.float32)
        return seen

    def observe(self) -> dict[str, np.ndarray]:
        """Return what is seen now."""
        cloud = self._see()
        pose = np.zeros((2, 7), np.float32)
        pose[:, :3], pose[:, 3] = self.hands, 1.0
        return {
            "joint_state": self._joints.astype(np.float32),
            "ee_pose": pose,
            "env_point_cloud": cloud,
            "image": _draw_image(cloud, self.image_size),
        }

    def execute(self, target: np.ndarray) -> dict[str, np.ndarray]:
        """Let the joints follow their targets [rad], shape (60,), for a frame."""
        target = np.asarray(target, dtype=np.float64)
        if target.shape != (JOINTS,) or not np.isfinite(target).all():
            raise ValueError(f"target must be finite, of shape ({JOINTS},); got {target.shape}")
        self._joints = self._joints + _LAG * (target - self._joints)
        return self.observe()

    def _see(self) -> np.ndarray:
        """Return points of sheet, hands and object with their colours, shape (N, 6)."""
        counts = [int(self.points * share) for share in _SHARES]
        counts.append(self.points - sum(counts))
        sheet = self._scene.garment[self._rng.permutation(self.points)[: counts[0]]]
        blobs = [
            hand + self._rng.normal(scale=0.03, size=(count, 3))
            for hand, count in zip(self.hands, counts[1:3], strict=True)
        ]
        rest = self._scene.object if self.has_object else self._scene.garment
        rest = rest[self._rng.permutation(len(rest))[: counts[3]]]
        colors = np.array([[0.9, 0.6, 0.2], [0.2, 0.3, 0.9], [0.2, 0.8, 0.3], [0.6, 0.6, 0.6]])
        if not self.has_object:
            colors[3] = colors[0]
        cloud = np.concatenate([sheet, *blobs, rest])
        return np.hstack([cloud, np.repeat(colors, counts, axis=0)]).astype(np.float32)


class SyntheticMatcher:
    """Finds points of one sheet on another, in place of a trained model.

    Sheets are the same but for how they lie, so a point's place in the sheet's own frame tells
    which it is. The frame is that of the cloud's principal axes: with 2,000 points, places are
    found to about 3 cm.
    """

    def match(
        self, source_cloud: np.ndarray, source_points: np.ndarray, target_cloud: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Match points of sheets; see `Matcher`. Similar is what is near on the sheet."""
        origin, axes = _find_frame(source_cloud)
        wanted = (source_points - origin) @ axes  # (K, 2)
        origin, axes = _find_frame(target_cloud)
        placed = (target_cloud - origin) @ axes  # (M, 2)
        distance = np.linalg.norm(placed[None] - wanted[:, None], axis=2)
        similarity = np.exp(-0.5 * (distance / _WIDTH) ** 2)
        return distance.argmin(axis=1), similarity


def write_synthetic_episodes(
    folder: str | Path,
    count: int,
    *,
    seed: int = 0,
    points: int = 2048,
    frames: int = 24,
    has_object: bool = True,
    image_size: tuple[int, int] = (48, 64),
) -> list[Path]:
    """Write expert episodes of the made-up task in the episode format.

    Args:
        folder: Where; made if missing.
        count: How many.
        seed: Of what is drawn; each episode has its own share.
        points: Points of each cloud.
        frames: Frames of an episode.
        has_object: Whether there is an object.
        image_size: Rows and columns of pictures [pixel]; collected episodes have 480 and 640.

    Returns:
        The files. They are written beside and renamed.
    """
    if count < 1:
        raise ValueError(f"count must be at least 1; got {count}")
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    environment = SyntheticEnvironment(
        points=points, frames=frames, has_object=has_object, image_size=image_size
    )
    paths: list[Path] = []
    for number in range(count):
        drawn = int(np.random.SeedSequence([seed, number]).generate_state(1)[0])
        environment.reset(seed=drawn)
        path = folder / f"Synthetic-v1-s{seed}-{number:05d}.h5"
        _write_episode(path, environment, seed=drawn)
        paths.append(path)
    return paths


def _draw_scene(rng: np.random.Generator, points: int, places: np.ndarray | None) -> _Scene:
    grid = rng.uniform(-1, 1, (points, 2))
    yaw = rng.uniform(-0.3, 0.3)
    R = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    centre = np.array([0.0, 0.8]) + rng.uniform(-0.1, 0.1, 2)
    flat = centre + (grid * _SHEET / 2) @ R.T
    garment = np.column_stack([flat, 0.01 + 0.01 * np.sin(6 * flat.sum(axis=1))])
    drawn = np.array([[-0.5, 0.0], [0.5, 0.0]]) + rng.uniform(-1, 1, (2, 2)) * [0.4, 0.8]
    wanted = drawn if places is None else np.asarray(places, dtype=np.float64)
    nearest = np.linalg.norm(grid[None] - wanted[:, None], axis=2).argmin(axis=1)
    corner = np.array([rng.uniform(-0.4, 0.4), rng.uniform(1.3, 1.5), 0.0])
    box = corner + rng.uniform(0, 1, (points, 3)) * [0.15, 0.15, 0.4]
    return _Scene(garment=garment, places=grid[nearest], goals=garment[nearest], object=box)


def _find_frame(cloud: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return centre, shape (3,), and both axes, shape (3, 2), of a hardly turned sheet."""
    centre = (cloud.min(axis=0) + cloud.max(axis=0)) / 2
    flat = cloud[:, :2] - cloud[:, :2].mean(axis=0)
    _, _, (long, _) = np.linalg.svd(flat, full_matrices=False)
    long = long * np.sign(long[0])  # Towards +x: sheets are turned by less than a right angle.
    axes = np.array([[long[0], -long[1]], [long[1], long[0]], [0.0, 0.0]])
    centre[:2] = cloud[:, :2].mean(axis=0)
    return centre, axes


def _draw_image(cloud: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Draw a cloud, shape (N, 6), from above: a pixel for each point."""
    height, width = size
    image = np.full((height, width, 3), 255, np.uint8)
    columns = ((cloud[:, 0] + 1.0) / 2.0 * width).astype(int).clip(0, width - 1)
    rows = ((1.6 - cloud[:, 1]) / 1.8 * height).astype(int).clip(0, height - 1)
    order = cloud[:, 2].argsort()  # What is higher hides what is lower.
    image[rows[order], columns[order]] = (cloud[order, 3:] * 255).astype(np.uint8)
    return image


def _write_episode(path: Path, environment: SyntheticEnvironment, *, seed: int) -> None:
    expert = environment.make_expert()
    static = environment.see_stage()
    static["points_affordance_feature"] = environment.get_affordance()
    seen: list[Mapping[str, np.ndarray]] = [environment.observe()]
    for target in expert:
        seen.append(environment.execute(target))
    frames = {key: np.stack([each[key] for each in seen[:-1]]) for key in seen[0]}
    frames["action"] = expert
    error = environment.compute_error()
    points = {
        name: {"xyz": goal.tolist()}
        for name, goal in zip(("left", "right"), environment.goals, strict=True)
    }
    with written_beside(path) as partial, h5py.File(partial, "w") as file:
        file.attrs.update(
            {
                "format_version": FORMAT_VERSION,
                "task": "Synthetic-v1",
                "seed": seed,
                "garment_id": "sheet",
                "robot": ROBOT,
                "matcher": "exact",
                "randomisation": "{}",
                "stage_names": json.dumps(["reach"]),
                "success": True,
                "success_value": error,
                "measurements": "{}",
                "package_versions": json.dumps({"dgl-sadp": metadata.version("dgl-sadp")}),
            }
        )
        group = file.create_group("stage_1", track_order=True)
        group.attrs.update({"name": "reach", "points": json.dumps(points)})
        for key, values in {**frames, **static}.items():
            chunks = (min(8, len(values)), *values.shape[1:]) if key in frames else values.shape
            group.create_dataset(
                key,
                data=values,
                chunks=chunks,
                compression="gzip",
                compression_opts=1,
                shuffle=True,
                fletcher32=True,
                track_times=False,
            )
