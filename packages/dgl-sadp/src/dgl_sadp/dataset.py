"""Windows over recorded episodes, as a diffusion policy is trained on them."""

import copy
import logging
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from dgl_files.fields import show
from dgl_sadp._episode_file import (
    FRAME_KEYS,
    EpisodeFile,
    FrameSlice,
    StageFile,
    measure_frames,
    read_frames,
    read_static,
    scan_episode,
    take_frames,
)
from dgl_sadp.errors import DamagedEpisodeError

__all__ = ["EpisodeDataset", "split_episodes"]

logger = logging.getLogger(__name__)

_OBSERVATION_KEYS = ("joint_state", "ee_pose", "env_point_cloud")


class EpisodeDataset:
    """All windows of all stages over a folder of episode files.

    A window is `horizon` consecutive frames of one stage. Its first `observation_steps` frames
    are observed; the `action_steps` actions from the last observed frame on are executed. Windows
    begin up to `observation_steps - 1` frames before a stage and at most with its last frame, where
    the edge frame is repeated: a policy also learns the first steps and to stay at the end.

    Frames are read from disk when needed; `keep_bytes` of them stay in memory. Arrays that do not
    change within a stage are read once and kept (about 65 kB a stage). The dataset is map-style
    and works with PyTorch's data loaders and workers; it needs no PyTorch, and no file stays open.

    Attributes:
        episodes: The successful episodes, by file name.
        stages: Number of their stages.
        parts: The stages of all episodes, in the order of the windows.
        counts: Number of windows of each part, shape (P,), int64.
        failed: Files of episodes that did not succeed; they are left out.
        refused: Errors of the files that were left out because of `skip_corrupt`.

    Source:
        Horizons: DexGarmentLab's code, which repeats `action_steps - 1` frames after a stage.
    """

    def __init__(
        self,
        directory: str | Path,
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
            ValueError: If an argument is out of range, no episode succeeded, they differ in their
                task, their stages, in having an object's cloud or in the kind of their environment
                clouds, or an approach is wanted and was not recorded.
            FileNotFoundError: If the folder holds no episode.
            DamagedEpisodeError: If a file is damaged or of another format.
        """
        if keep_bytes < 0:
            raise ValueError(f"keep_bytes must be at least 0; got {keep_bytes}")
        _check_steps(horizon, observation_steps, action_steps)
        allowed = [key for key in FRAME_KEYS if key != "action"]
        if not set(observation_keys) <= set(allowed):
            raise ValueError(f"observation_keys must be of {allowed}; got {list(observation_keys)}")
        self.horizon = horizon
        self.observation_steps = observation_steps
        self.action_steps = action_steps
        self.observation_keys = tuple(observation_keys)
        self.keep_bytes = keep_bytes
        episodes, self.failed, self.refused = _scan(
            Path(directory), skip_corrupt=skip_corrupt, with_approach=with_approach
        )
        self.stages = len(episodes[0].stages)
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

            * `stage`, from 0, int64;
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

        part = self.parts[number]
        observed = FrameSlice(start, start + self.observation_steps)
        wanted = dict.fromkeys(self.observation_keys, observed)
        wanted["action"] = FrameSlice(start, start + self.horizon)
        kept = self._keep(part)
        if kept is None:
            window = read_frames(part, wanted)
        else:
            window = {key: take_frames(kept[key], frames) for key, frames in wanted.items()}
        window.update((key, array.copy()) for key, array in self._read_static(part).items())
        window["stage"] = np.array(part.stage - 1)
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

    def _use(self, episodes: tuple[EpisodeFile, ...]) -> None:
        """Draw windows from these episodes."""
        self.episodes = episodes
        self.parts = tuple(part for episode in episodes for part in episode.stages)
        self._static: dict[StageFile, dict[str, np.ndarray]] = {}
        self._kept: dict[StageFile, dict[str, np.ndarray]] = {}
        self._kept_bytes = 0
        counts = [part.frames + self.observation_steps - 1 for part in self.parts]
        self.counts = np.array(counts, dtype=np.int64)
        self._ends = np.cumsum(self.counts)  # Windows up to and with each part.

    def _keep(self, part: StageFile) -> dict[str, np.ndarray] | None:
        """Return all frames of a stage if they are in memory or fit into it."""
        kept = self._kept.get(part)
        if kept is None and self._kept_bytes < self.keep_bytes:
            keys = (*self.observation_keys, "action")
            size = measure_frames(part, keys)
            if self._kept_bytes + size <= self.keep_bytes:
                whole = FrameSlice(0, part.frames)
                kept = read_frames(part, dict.fromkeys(keys, whole))
                self._kept[part] = kept
                self._kept_bytes += size
        return kept

    def _read_static(self, part: StageFile) -> dict[str, np.ndarray]:
        if part not in self._static:
            start = read_frames(part, {"joint_state": FrameSlice(0, 1)})["joint_state"][0]
            self._static[part] = {"start_joint_state": start, **read_static(part)}
        return self._static[part]


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


def _check_steps(horizon: int, observation_steps: int, action_steps: int) -> None:
    for name, value in (
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
    directory: Path, *, skip_corrupt: bool, with_approach: bool
) -> tuple[tuple[EpisodeFile, ...], tuple[Path, ...], tuple[DamagedEpisodeError, ...]]:
    # Hidden files are those that a writer has not finished.
    paths = sorted(path for path in directory.glob("*.h5") if not path.name.startswith("."))
    if not paths:
        below = sorted({path.parent for path in directory.glob("*/*.h5")})
        hint = f"; did you mean {below[0]}?" if below else ""
        raise FileNotFoundError(f"no episode files (*.h5) in {directory}{hint}")
    episodes: list[EpisodeFile] = []
    failed: list[Path] = []
    refused: list[DamagedEpisodeError] = []
    for path in paths:
        try:
            episode = scan_episode(path, with_approach=with_approach)
        except DamagedEpisodeError as error:
            if not skip_corrupt:
                raise
            logger.warning("left out: %s", error)
            refused.append(error)
            continue
        if episode is None:
            failed.append(path)
        else:
            episodes.append(episode)
    if not episodes:
        also = f", and {len(refused)} are refused: {refused[0]}" if refused else ""
        raise ValueError(f"none of the {len(failed)} episode(s) in {directory} succeeded{also}")
    parts = [part for episode in episodes for part in episode.stages]
    for wanted, found in {
        "be of one task": {episode.task: episode.path for episode in episodes},
        "agree in the number of their stages": {
            len(episode.stages): episode.path for episode in episodes
        },
        "agree in having an object_point_cloud or not": {
            part.static_keys: part.path for part in parts
        },
        "have one kind of env_point_cloud (--cloud of dgl collect)": {
            episode.cloud: episode.path for episode in episodes
        },
    }.items():
        if len(found) > 1:
            told = " but ".join(f"{path.name} has {show(value)}" for value, path in found.items())
            raise ValueError(f"the episodes must {wanted}; {told}")
    return tuple(episodes), tuple(failed), tuple(refused)
