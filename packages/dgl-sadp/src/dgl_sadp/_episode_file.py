"""Reading of one stage of one episode file.

The format is written by another package; what is needed of it is repeated here, so that neither needs the other.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np

from dgl_sadp.errors import CorruptEpisodeError

__all__ = [
    "FORMAT_VERSION",
    "FRAME_KEYS",
    "JOINTS",
    "FrameSlice",
    "StageFile",
    "measure_frames",
    "read_frames",
    "read_static",
    "scan_stage",
    "take_frames",
]

FORMAT_VERSION = 1
ROBOT = "ur10e+shadow"  # What files are recorded with that name no robot.
JOINTS = 60  # Left arm 6, left hand 24, right arm 6, right hand 24.

# Key -> shape of one frame (None: any size) and dtype.
FRAME_KEYS: dict[str, tuple[tuple[int | None, ...], str]] = {
    "joint_state": ((JOINTS,), "float32"),
    "action": ((JOINTS,), "float32"),
    "ee_pose": ((2, 7), "float32"),
    "image": ((None, None, 3), "uint8"),
    "env_point_cloud": ((None, 6), "float32"),
}
# Key -> shape and dtype of what is stored once in a stage.
_STATIC_KEYS: dict[str, tuple[tuple[int | None, ...], str]] = {
    "garment_point_cloud": ((None, 3), "float32"),
    "points_affordance_feature": ((None, 2), "float32"),
    "object_point_cloud": ((None, 3), "float32"),
}
_OPTIONAL_KEYS = frozenset({"object_point_cloud"})


@dataclass(frozen=True, kw_only=True)
class StageFile:
    """One stage of one whole, successful episode."""

    path: Path
    """The file."""
    stage: int
    """Number of the stage, from 1."""
    frames: int
    """Number of frames T, at least 1, that are used of those recorded."""
    first: int
    """Where they begin: the frames before are the hands' approach."""
    static_keys: tuple[str, ...]
    """Which of the arrays that are stored once in a stage are there."""
    task: str
    """Environment id, such as `FoldTops-v1`; empty if it was not recorded."""


@dataclass(frozen=True)
class FrameSlice:
    """Frames from `start` up to, not including, `stop`; either may lie outside of the stage."""

    start: int
    stop: int


def scan_stage(path: Path, stage: int, *, with_approach: bool = False) -> StageFile | None:
    """Check one stage of a file without reading its arrays.

    Args:
        path: The file.
        stage: Number of the stage, from 1.
        with_approach: Whether the hands' way to the grasp points is wanted, too.

    Returns:
        What is there, or None if the episode did not succeed.

    Raises:
        CorruptEpisodeError: If the file is not a whole episode of the known format, or lacks the stage.
        ValueError: If the approach is wanted and was not recorded.
    """
    with _open(path) as file:
        version = file.attrs.get("format_version")
        if version is None:
            raise CorruptEpisodeError(path, "no attribute format_version")
        if int(version) != FORMAT_VERSION:
            raise CorruptEpisodeError(
                path, f"format version {version}; this package reads {FORMAT_VERSION}"
            )
        if "success" not in file.attrs:
            raise CorruptEpisodeError(path, "no attribute success")
        if not bool(file.attrs["success"]):
            return None
        robot = str(file.attrs.get("robot", ROBOT))
        if robot != ROBOT:
            raise CorruptEpisodeError(path, f"recorded with robot {robot}; policies are of {ROBOT}")
        group = file.get(f"stage_{stage}")
        if not isinstance(group, h5py.Group):
            stages = sorted(str(key) for key in file if str(key).startswith("stage_"))
            raise CorruptEpisodeError(path, f"no stage_{stage}; it has {stages}")
        frames = _check_frames(path, group)
        approach = int(group.attrs.get("approach_frames", 0))
        if not 0 <= approach < frames:
            raise CorruptEpisodeError(
                path, f"approach_frames of {group.name} must lie in [0, {frames}); got {approach}"
            )
        if with_approach and approach == 0:
            raise ValueError(
                f"{path.name}: stage {stage} must have its approach recorded; it has not: "
                "collect with --record approaches"
            )
        first = 0 if with_approach else approach
        return StageFile(
            path=path,
            stage=stage,
            frames=frames - first,
            first=first,
            static_keys=_check_static(path, group),
            task=str(file.attrs.get("task", "")),
        )


def read_frames(file: StageFile, wanted: dict[str, FrameSlice]) -> dict[str, np.ndarray]:
    """Read ranges of the used frames, repeating the first and the last one outside of them.

    Args:
        file: The stage.
        wanted: Key of each array and its frames.

    Returns:
        Arrays of the dtypes of the file, shape (stop - start, ...).

    Raises:
        CorruptEpisodeError: If the file has been damaged since it was scanned.
    """
    arrays: dict[str, np.ndarray] = {}
    with _open(file.path) as opened:
        for key, part in wanted.items():
            index = np.clip(np.arange(part.start, part.stop), 0, file.frames - 1)
            first, last = int(index[0]), int(index[-1])
            # One contiguous read; repeating happens in memory.
            dataset = _dataset(file.path, opened, f"stage_{file.stage}/{key}")
            arrays[key] = dataset[file.first + first : file.first + last + 1][index - first]
    return arrays


def take_frames(stored: np.ndarray, part: FrameSlice) -> np.ndarray:
    """Take a range of the frames of a whole stage, shape (T, ...), as `read_frames` does."""
    return stored[np.clip(np.arange(part.start, part.stop), 0, len(stored) - 1)]


def measure_frames(file: StageFile, keys: Sequence[str]) -> int:
    """Return how much memory all frames of these arrays take [byte].

    Raises:
        CorruptEpisodeError: If the file has been damaged since it was scanned.
    """
    with _open(file.path) as opened:
        stored = [_dataset(file.path, opened, f"stage_{file.stage}/{key}") for key in keys]
        return sum(array.nbytes // len(array) * file.frames for array in stored)


def read_static(file: StageFile) -> dict[str, np.ndarray]:
    """Read the arrays that are stored once in the stage.

    Raises:
        CorruptEpisodeError: If the file has been damaged since it was scanned.
    """
    with _open(file.path) as opened:
        return {
            key: _dataset(file.path, opened, f"stage_{file.stage}/{key}")[()]
            for key in file.static_keys
        }


@contextmanager
def _open(path: Path) -> Iterator[h5py.File]:
    """Open a file for reading, and name it in whatever HDF5 has to complain about."""
    try:
        with h5py.File(path, "r") as file:
            yield file
    except FileNotFoundError:
        raise
    # HDF5 reports damage as OSError, RuntimeError or KeyError, depending on where it lies.
    except (OSError, RuntimeError, KeyError) as error:
        reason = str(error.args[0]) if error.args else type(error).__name__
        raise CorruptEpisodeError(path, f"cannot be read as an episode ({reason})") from error


def _check_frames(path: Path, group: h5py.Group) -> int:
    counts: dict[str, int] = {}
    for key, (shape, dtype) in FRAME_KEYS.items():
        dataset = _dataset(path, group, key)
        _check_array(path, dataset, (None, *shape), dtype)
        counts[key] = dataset.shape[0]
    if len(set(counts.values())) != 1:
        raise CorruptEpisodeError(path, f"{group.name} has arrays of different lengths: {counts}")
    frames = counts["joint_state"]
    if frames < 1:
        raise CorruptEpisodeError(path, f"{group.name} has no frames")
    return frames


def _check_static(path: Path, group: h5py.Group) -> tuple[str, ...]:
    points: dict[str, int] = {}
    for key, (shape, dtype) in _STATIC_KEYS.items():
        if key in _OPTIONAL_KEYS and key not in group:
            continue
        dataset = _dataset(path, group, key)
        _check_array(path, dataset, shape, dtype)
        points[key] = dataset.shape[0]
    if points["garment_point_cloud"] != points["points_affordance_feature"]:
        raise CorruptEpisodeError(
            path,
            f"{group.name} has {points['garment_point_cloud']} garment points; "
            f"{points['points_affordance_feature']} affordance rows",
        )
    return tuple(points)


def _dataset(path: Path, group: h5py.Group, key: str) -> h5py.Dataset:
    dataset = group.get(key)
    if not isinstance(dataset, h5py.Dataset):
        raise CorruptEpisodeError(path, f"no array {str(group.name).rstrip('/')}/{key}")
    return dataset


def _check_array(
    path: Path, dataset: h5py.Dataset, shape: Sequence[int | None], dtype: str
) -> None:
    is_shape = len(dataset.shape) == len(shape) and all(
        want is None or want == got for want, got in zip(shape, dataset.shape, strict=True)
    )
    if not is_shape or dataset.dtype != np.dtype(dtype):
        wanted = tuple("any" if size is None else size for size in shape)
        raise CorruptEpisodeError(
            path,
            f"{dataset.name} must be {dtype} of shape {wanted}; got {dataset.dtype} of {dataset.shape}",
        )
