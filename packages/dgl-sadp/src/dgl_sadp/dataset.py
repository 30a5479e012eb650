"""Windows over recorded episodes, as a diffusion policy is trained on them."""

import copy
import logging
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from dgl_files.fields import tell
from dgl_sadp._episode_file import (
    FRAME_KEYS,
    FrameSlice,
    MissingStageError,
    StageFile,
    measure_frames,
    read_frames,
    read_static,
    scan_stage,
    take_frames,
)
from dgl_sadp.errors import DamagedEpisodeError

__all__ = ["EpisodeDataset", "split_episodes"]

logger = logging.getLogger(__name__)

_OBSERVATION_KEYS = ("joint_state", "ee_pose", "env_point_cloud")


class EpisodeDataset:
    """All windows of one stage over a folder of episode files.

    A window is `horizon` consecutive frames of one episode. Its first `observation_steps` frames
    are observed; the `action_steps` actions from the last observed frame on are executed. Windows
    begin up to `observation_steps - 1` frames before a stage and at most with its last frame, where
    the edge frame is repeated: a policy also learns the first steps and to stay at the end.

    Frames are read from disk when needed; `keep_bytes` of them stay in memory. Arrays that do not
    change within a stage are read once and kept (about 65 kB an episode). The dataset is map-style
    and works with PyTorch's data loaders and workers; it needs no PyTorch, and no file stays open.

    Attributes:
        episodes: The successful episodes, by file name.
        failed: Files of episodes that did not succeed; they are left out.
        refused: Errors of the files that were left out because of `skip_corrupt`.

    Source:
        Horizons: DexGarmentLab's code, which repeats `action_steps - 1` frames after a stage.
    """

    def __init__(
        self,
        directory: str | Path,
        stage: int,
        horizon: int = 8,
        observation_steps: int = 3,
        action_steps: int = 4,
        *,
        observation_keys: Sequence[str] = _OBSERVATION_KEYS,
        keep_bytes: int = 0,
        skip_corrupt: bool = False,
        with_approach: bool = False,
    ) -> None:
        """Find and check the episodes; none of their arrays is read yet.

        Args:
            directory: Folder of episode files (`*.h5`).
            stage: Number of the stage, from 1.
            horizon: Frames in a window.
            observation_steps: Observed frames.
            action_steps: Executed actions; with the observed frames they must fit into the horizon.
            observation_keys: Which recorded arrays are observed; add `image` for pictures.
            keep_bytes: Memory for frames [byte]: episodes are kept whole once read, as long as they
                fit. The windows of all others are read from disk each time.
            skip_corrupt: Whether damaged files and those of another format are left out, logged and
                listed in `refused`, rather than raised.
            with_approach: Whether a stage begins when the hands leave their parking place, rather
                than when they have reached the grasp points.

        Raises:
            ValueError: If an argument is out of range, no episode succeeded or has the stage, only
                some episodes have an object's cloud, their environment clouds are of several kinds,
                or an approach is wanted and was not recorded.
            FileNotFoundError: If the folder holds no episode.
            DamagedEpisodeError: If a file is damaged or of another format.
        """
        if keep_bytes < 0:
            raise ValueError(f"keep_bytes must be at least 0; got {keep_bytes}")
        _check_steps(stage, horizon, observation_steps, action_steps)
        allowed = [key for key in FRAME_KEYS if key != "action"]
        if not set(observation_keys) <= set(allowed):
            raise ValueError(f"observation_keys must be of {allowed}; got {list(observation_keys)}")
        self.stage = stage
        self.horizon = horizon
        self.observation_steps = observation_steps
        self.action_steps = action_steps
        self.observation_keys = tuple(observation_keys)
        self.keep_bytes = keep_bytes
        episodes, self.failed, self.refused = _scan(
            Path(directory), stage, skip_corrupt=skip_corrupt, with_approach=with_approach
        )
        self._use(episodes)

    def __len__(self) -> int:
        """Return the number of windows."""
        return int(self._ends[-1])

    def __iter__(self) -> Iterator[dict[str, np.ndarray]]:
        """Iterate over the windows in order."""
        return (self[index] for index in range(len(self)))

    def __getitem__(self, index: int) -> dict[str, np.ndarray]:
        """Read one window.

        Args:
            index: Number of the window; negative ones count from the end.

        Returns:
            With To = `observation_steps`, T = `horizon`, N and M numbers of points, float32 where
            not stated:

            * `start_joint_state` [rad], where the stage began, shape (60,); `joint_state` [rad],
              shape (To, 60); `ee_pose` (left, right) [m] and quaternion wxyz, world frame, shape
              (To, 2, 7); `env_point_cloud` xyz [m], world frame, and colour, shape (To, N, 6); and
              `image`, shape (To, H, W, 3), uint8, where asked for;
            * `action`, the commanded joint targets [rad], shape (T, 60);
            * `garment_point_cloud` [m], world frame, shape (M, 3), `points_affordance_feature`
              (left, right) in [0, 1], shape (M, 2), and, where recorded, `object_point_cloud` [m],
              world frame, shape (N, 3).

            The arrays are the caller's to change.

        Raises:
            IndexError: If there is no such window.
            DamagedEpisodeError: If the file has been damaged since it was scanned.
        """
        count = len(self)
        if not -count <= index < count:
            raise IndexError(f"window {index} of {count}")
        index %= count
        number = int(np.searchsorted(self._ends, index, side="right"))
        before = int(self._ends[number - 1]) if number else 0
        start = index - before - (self.observation_steps - 1)

        episode = self.episodes[number]
        observed = FrameSlice(start, start + self.observation_steps)
        wanted = dict.fromkeys(self.observation_keys, observed)
        wanted["action"] = FrameSlice(start, start + self.horizon)
        kept = self._keep(episode)
        if kept is None:
            window = read_frames(episode, wanted)
        else:
            window = {key: take_frames(kept[key], part) for key, part in wanted.items()}
        window.update((key, array.copy()) for key, array in self._read_static(episode).items())
        return window

    def select(self, episodes: Sequence[int] | np.ndarray) -> "EpisodeDataset":
        """Return a dataset of some of the episodes, such as one side of `split_episodes`.

        Args:
            episodes: Indices into `episodes`.

        Raises:
            ValueError: If none is named, one is named twice, or there is no such episode.
        """
        chosen = [int(number) for number in episodes]
        count = len(self.episodes)
        if not chosen or len(set(chosen)) != len(chosen):
            raise ValueError(f"episodes must be distinct and at least one; got {chosen}")
        if min(chosen) < 0 or max(chosen) >= count:
            raise ValueError(f"episodes must lie in 0 ... {count - 1}; got {chosen}")
        part = copy.copy(self)
        part._use(tuple(self.episodes[number] for number in chosen))  # noqa: SLF001 - our own class
        return part

    def _use(self, episodes: tuple[StageFile, ...]) -> None:
        """Draw windows from these episodes."""
        self.episodes = episodes
        self._static: dict[Path, dict[str, np.ndarray]] = {}
        self._kept: dict[Path, dict[str, np.ndarray]] = {}
        self._kept_bytes = 0
        counts = [episode.frames + self.observation_steps - 1 for episode in episodes]
        self._ends = np.cumsum(counts, dtype=np.int64)  # Windows up to and with each episode.

    def _keep(self, episode: StageFile) -> dict[str, np.ndarray] | None:
        """Return all frames of an episode if they are in memory or fit into it."""
        kept = self._kept.get(episode.path)
        if kept is None and self._kept_bytes < self.keep_bytes:
            keys = (*self.observation_keys, "action")
            size = measure_frames(episode, keys)
            if self._kept_bytes + size <= self.keep_bytes:
                whole = FrameSlice(0, episode.frames)
                kept = read_frames(episode, dict.fromkeys(keys, whole))
                self._kept[episode.path] = kept
                self._kept_bytes += size
        return kept

    def _read_static(self, episode: StageFile) -> dict[str, np.ndarray]:
        if episode.path not in self._static:
            start = read_frames(episode, {"joint_state": FrameSlice(0, 1)})["joint_state"][0]
            self._static[episode.path] = {"start_joint_state": start, **read_static(episode)}
        return self._static[episode.path]


def split_episodes(n: int, fraction: float = 0.02, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Divide episodes into those to train on and those to validate on.

    Whole episodes are divided, never windows: neighbouring windows share frames.

    Args:
        n: Number of episodes, at least 2.
        fraction: Share for validation, in (0, 1); at least one episode, and never all of them.
        seed: Seed of the choice.

    Returns:
        Sorted indices for training and for validation, shapes (n - v,) and (v,), int64.

    Raises:
        ValueError: If `n` or `fraction` is out of range.

    Source:
        2 %: DexGarmentLab, paper; the seed 0: its code.
    """
    if n < 2:
        raise ValueError(f"n must be at least 2, one for each side; got {n}")
    if not 0.0 < fraction < 1.0:
        raise ValueError(f"fraction must lie in (0, 1); got {fraction}")
    count = min(max(1, round(n * fraction)), n - 1)
    is_validation = np.zeros(n, dtype=bool)
    is_validation[np.random.default_rng(seed).choice(n, size=count, replace=False)] = True
    return np.flatnonzero(~is_validation), np.flatnonzero(is_validation)


def _check_steps(stage: int, horizon: int, observation_steps: int, action_steps: int) -> None:
    for name, value in (
        ("stage", stage),
        ("observation_steps", observation_steps),
        ("action_steps", action_steps),
    ):
        if value < 1:
            raise ValueError(f"{name} must be at least 1; got {value}")
    needed = observation_steps - 1 + action_steps
    if horizon < needed:
        raise ValueError(
            f"horizon must be at least observation_steps - 1 + action_steps = {needed}; got "
            f"{horizon}"
        )


def _scan(
    directory: Path,
    stage: int,
    *,
    skip_corrupt: bool,
    with_approach: bool,
) -> tuple[tuple[StageFile, ...], tuple[Path, ...], tuple[DamagedEpisodeError, ...]]:
    # Hidden files are those that a writer has not finished.
    paths = sorted(path for path in directory.glob("*.h5") if not path.name.startswith("."))
    if not paths:
        below = sorted({path.parent for path in directory.glob("*/*.h5")})
        hint = f"; did you mean {below[0]}?" if below else ""
        raise FileNotFoundError(f"no episode files (*.h5) in {directory}{hint}")
    episodes: list[StageFile] = []
    failed: list[Path] = []
    refused: list[DamagedEpisodeError] = []
    for path in paths:
        try:
            episode = scan_stage(path, stage, with_approach=with_approach)
        except DamagedEpisodeError as error:
            # That no episode has the stage is said once, below.
            if not skip_corrupt and not isinstance(error, MissingStageError):
                raise
            refused.append(error)
            continue
        if episode is None:
            failed.append(path)
        else:
            episodes.append(episode)
    lacking = [error for error in refused if isinstance(error, MissingStageError)]
    if lacking and not episodes:
        raise ValueError(_describe_stages(directory, stage, lacking))
    for error in refused:
        if not skip_corrupt:
            raise error
        logger.warning("left out: %s", error)
    if not episodes:
        also = f", and {len(refused)} are refused: {refused[0]}" if refused else ""
        raise ValueError(f"none of the {len(failed)} episode(s) in {directory} succeeded{also}")
    kinds = {episode.static_keys: episode.path for episode in episodes}
    if len(kinds) > 1:
        raise ValueError(
            "the episodes must agree in having an object_point_cloud or not; "
            + " but ".join(f"{path.name} has {list(keys)}" for keys, path in kinds.items())
        )
    clouds = {episode.cloud: episode.path for episode in episodes}
    if len(clouds) > 1:
        raise ValueError(
            "the episodes must have one kind of env_point_cloud (--cloud of dgl collect); "
            + " but ".join(f"{path.name} has {tell(kind)}" for kind, path in clouds.items())
        )
    return tuple(episodes), tuple(failed), tuple(refused)


def _describe_stages(directory: Path, stage: int, lacking: list[MissingStageError]) -> str:
    """Say which stages there are where no episode has the one that is asked for."""
    numbers = sorted({number for error in lacking for number in error.stages})
    tasks = " and ".join(sorted({tell(error.task) for error in lacking if error.task}))
    return (
        f"stage must be one of {numbers}, which the {len(lacking)} episode(s)"
        f"{f' of {tasks}' if tasks else ''} in {directory} have; got {stage}"
    )
