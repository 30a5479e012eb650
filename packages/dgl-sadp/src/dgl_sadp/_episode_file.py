"""Reading of one stage of one episode file.

The format is written by another package; what is needed of it is repeated here, so that neither
needs the other.
"""

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import h5py
import numpy as np

from dgl_files.fields import show, tell
from dgl_files.whole import describe_access_fault
from dgl_sadp.errors import DamagedEpisodeError, EpisodeAccessError, UnsuitableEpisodeError

__all__ = [
    "FORMAT_VERSION",
    "FRAME_KEYS",
    "JOINTS",
    "STATIC_KEYS",
    "EpisodeFile",
    "FrameSlice",
    "StageFile",
    "measure_frames",
    "read_frames",
    "read_static",
    "scan_episode",
    "take_frames",
]

FORMAT_VERSION = 1
ROBOT = "ur10e+shadow"  # What files are recorded with that name no robot.
CLOUD = "segmented"  # The kind of cloud of files that name none.
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
STATIC_KEYS: dict[str, tuple[tuple[int | None, ...], str]] = {
    "garment_point_cloud": ((None, 3), "float32"),
    "points_affordance_feature": ((None, 2), "float32"),
    "object_point_cloud": ((None, 3), "float32"),
}
_OPTIONAL_KEYS = frozenset({"object_point_cloud"})

MAX_FRAMES = 100_000
"""Of a stage: two hours at 12 Hz."""
MAX_POINTS = 2**18
"""Of a cloud."""
MAX_PIXELS = 2**22
"""Of a picture: 2048 x 2048."""
MAX_COMPRESSION = 1100
"""Most declared bytes for each stored byte; gzip cannot reach it. Arrays beyond it were declared
but not written."""
MAX_CHUNK_BYTES = 2**28
"""A chunk is read as a whole."""
MAX_TEXT = 200
"""Characters of a text attribute."""
_MAX_STAGES = 1000
# HDF5 and h5py report damage by these, depending on where it lies.
_HDF5_ERRORS = (
    OSError,
    RuntimeError,
    KeyError,
    ValueError,
    TypeError,
    OverflowError,
    MemoryError,
    AttributeError,
    IndexError,
    SystemError,
)


@dataclass(frozen=True, kw_only=True)
class StageFile:
    """One stage of an episode."""

    path: Path
    """The file."""
    stage: int
    """Number of the stage, from 1."""
    frames: int
    """Number of frames T, at least 1, that are used of those recorded."""
    first: int
    """First used frame; the frames before it are the approach."""
    static_keys: tuple[str, ...]
    """Names of the arrays stored once in the stage."""


@dataclass(frozen=True, kw_only=True)
class EpisodeFile:
    """One whole, successful episode."""

    path: Path
    """The file."""
    task: str
    """Environment id, such as `FoldTops-v1`; empty if it was not recorded."""
    cloud: str
    """Kind of `env_point_cloud`, as the file's attribute says."""
    stages: tuple[StageFile, ...]
    """The stages, at least one, in order."""


@dataclass(frozen=True)
class FrameSlice:
    """Frames from `start` up to, not including, `stop`; either may lie outside of the stage."""

    start: int
    stop: int


def scan_episode(path: Path, *, with_approach: bool = False) -> EpisodeFile | None:
    """Check the stages of a file without reading their arrays.

    Args:
        path: The file.
        with_approach: Whether the hands' way to the grasp points is wanted, too.

    Returns:
        What is there, or None if the episode did not succeed.

    Raises:
        DamagedEpisodeError: If the file is not a whole episode of the known format.
        ValueError: If the approach is wanted and was not recorded.
    """
    try:
        with _open(path) as file:
            version = _read_integer(path, file, "format_version")
            if version != FORMAT_VERSION:
                raise UnsuitableEpisodeError(
                    path, f"format version {version}; this package reads {FORMAT_VERSION}"
                )
            if not _read_truth(path, file, "success"):
                return None
            robot = _read_text(path, file, "robot", ROBOT)
            if robot != ROBOT:
                raise UnsuitableEpisodeError(
                    path, f"recorded with robot {tell(robot)}; policies are of {ROBOT}"
                )
            task = _read_text(path, file, "task", "")
            cloud = _read_text(path, file, "cloud", CLOUD)
            count = max((n for n in range(1, _MAX_STAGES) if f"stage_{n}" in file), default=0)
            if not count:
                raise DamagedEpisodeError(path, "it has no stages")
            stages = [_scan_stage(path, file, number) for number in range(1, count + 1)]
    except FileNotFoundError as error:
        raise DamagedEpisodeError(path, "there is no such file, or it is a link to none") from error
    if with_approach:
        for part in stages:
            if part.first == 0:
                raise ValueError(
                    f"{path.name}: stage {part.stage} must have its approach recorded; it has not: "
                    "collect with --record approaches"
                )
        stages = [replace(part, frames=part.frames + part.first, first=0) for part in stages]
    return EpisodeFile(path=path, task=task, cloud=cloud, stages=tuple(stages))


def _scan_stage(path: Path, file: h5py.File, number: int) -> StageFile:
    if f"stage_{number}" not in file:
        raise DamagedEpisodeError(path, f"no stage_{number}")
    group = _find_group(path, file, f"stage_{number}")
    frames = _check_frames(path, group)
    approach = _read_integer(path, group, "approach_frames", 0)
    if not 0 <= approach < frames:
        raise DamagedEpisodeError(
            path, f"approach_frames of {group.name} must lie in [0, {frames}); got {approach}"
        )
    return StageFile(
        path=path,
        stage=number,
        frames=frames - approach,
        first=approach,
        static_keys=_check_static(path, group),
    )


def read_frames(file: StageFile, wanted: dict[str, FrameSlice]) -> dict[str, np.ndarray]:
    """Read ranges of the used frames, repeating the first and the last one outside of them.

    Args:
        file: The stage.
        wanted: Key of each array and its frames.

    Returns:
        Arrays of the dtypes of the file, shape (stop - start, ...).

    Raises:
        DamagedEpisodeError: If the file has been damaged since it was scanned.
    """
    arrays: dict[str, np.ndarray] = {}
    with _open(file.path) as opened:
        group = _find_group(file.path, opened, f"stage_{file.stage}")
        for key, part in wanted.items():
            index = np.clip(np.arange(part.start, part.stop), 0, file.frames - 1)
            first, last = int(index[0]), int(index[-1])
            # One contiguous read; repeating happens in memory.
            dataset = _find_dataset(file.path, group, key)
            arrays[key] = dataset[file.first + first : file.first + last + 1][index - first]
    return arrays


def take_frames(stored: np.ndarray, part: FrameSlice) -> np.ndarray:
    """Take a range of the frames of a whole stage, shape (T, ...), as `read_frames` does."""
    return stored[np.clip(np.arange(part.start, part.stop), 0, len(stored) - 1)]


def measure_frames(file: StageFile, keys: Sequence[str]) -> int:
    """Return how much memory all frames of these arrays take [byte].

    Raises:
        DamagedEpisodeError: If the file has been damaged since it was scanned.
    """
    with _open(file.path) as opened:
        group = _find_group(file.path, opened, f"stage_{file.stage}")
        stored = [_find_dataset(file.path, group, key) for key in keys]
        return sum(array.nbytes // len(array) * file.frames for array in stored)


def read_static(file: StageFile) -> dict[str, np.ndarray]:
    """Read the arrays that are stored once in the stage.

    Raises:
        DamagedEpisodeError: If the file has been damaged since it was scanned.
    """
    with _open(file.path) as opened:
        group = _find_group(file.path, opened, f"stage_{file.stage}")
        return {key: _find_dataset(file.path, group, key)[()] for key in file.static_keys}


@contextmanager
def _open(path: Path) -> Iterator[h5py.File]:
    """Open a file for reading, and name it in whatever HDF5 has to complain about."""
    try:
        if path.exists() and not path.is_file():  # To open a pipe would wait for ever.
            raise DamagedEpisodeError(path, "cannot be read as an episode (it is no file)")
        with h5py.File(path, "r") as file:
            yield file
    except FileNotFoundError:
        raise
    except _HDF5_ERRORS as error:
        if fault := describe_access_fault(error):
            raise EpisodeAccessError(path, fault) from error
        reason = " ".join(str(error.args[0] if error.args else "").split())
        reason = reason[:200] or type(error).__name__
        raise DamagedEpisodeError(path, f"cannot be read as an episode ({reason})") from error


def _check_frames(path: Path, group: h5py.Group) -> int:
    found = {key: _find_dataset(path, group, key) for key in FRAME_KEYS}
    for key, (shape, dtype) in FRAME_KEYS.items():
        _check_array(path, found[key], (None, *shape), dtype)
    counts = {key: dataset.shape[0] for key, dataset in found.items()}
    if len(set(counts.values())) != 1:
        raise DamagedEpisodeError(path, f"{group.name} has arrays of different lengths: {counts}")
    frames = counts["joint_state"]
    if not 1 <= frames <= MAX_FRAMES:
        raise DamagedEpisodeError(
            path, f"{group.name} must have 1 ... {MAX_FRAMES} frames; got {frames}"
        )
    pixels, points = math.prod(found["image"].shape[1:3]), found["env_point_cloud"].shape[1]
    for what, count, limit in (
        ("pixels", pixels, MAX_PIXELS),
        ("environment points", points, MAX_POINTS),
    ):
        if not 1 <= count <= limit:
            raise DamagedEpisodeError(
                path, f"{group.name} must have 1 ... {limit} {what} a frame; got {count}"
            )
    for dataset in found.values():
        _check_stored(path, dataset)
    return frames


def _check_static(path: Path, group: h5py.Group) -> tuple[str, ...]:
    points: dict[str, int] = {}
    for key, (shape, dtype) in STATIC_KEYS.items():
        if key in _OPTIONAL_KEYS and key not in group:
            continue
        dataset = _find_dataset(path, group, key)
        _check_array(path, dataset, shape, dtype)
        points[key] = dataset.shape[0]
        if points[key] > MAX_POINTS:
            raise DamagedEpisodeError(
                path, f"{dataset.name} must have at most {MAX_POINTS} points; got {points[key]}"
            )
        _check_stored(path, dataset)
    if points["garment_point_cloud"] != points["points_affordance_feature"]:
        raise DamagedEpisodeError(
            path,
            f"{group.name} has {points['garment_point_cloud']} garment points; "
            f"{points['points_affordance_feature']} affordance rows",
        )
    return tuple(points)


def _find_group(path: Path, parent: h5py.Group, key: str) -> h5py.Group:
    node = _follow(path, parent, key)
    if not isinstance(node, h5py.Group):
        raise DamagedEpisodeError(path, f"{key} must be a group; got {type(node).__name__}")
    return node


def _find_dataset(path: Path, group: h5py.Group, key: str) -> h5py.Dataset:
    """Return an array that lies in the file itself."""
    dataset = _follow(path, group, key) if key in group else None
    if not isinstance(dataset, h5py.Dataset):
        raise DamagedEpisodeError(path, f"no array {str(group.name).rstrip('/')}/{key}")
    if dataset.is_virtual or dataset.external:
        raise DamagedEpisodeError(
            path, f"{dataset.name} must be in the file itself; got data of other files"
        )
    return dataset


def _follow(path: Path, parent: h5py.Group, key: str) -> object:
    """Return a member of a group, unless it is a link, which may lead out of the file."""
    link = parent.get(key, getlink=True)
    if not isinstance(link, h5py.HardLink):
        raise DamagedEpisodeError(path, f"{key} must be in the file itself; got {_name(link)}")
    return parent.get(key)


def _name(link: object) -> str:
    return {h5py.ExternalLink: "a link to another file", h5py.SoftLink: "a link"}.get(
        type(link), "nothing"
    )


def _check_array(
    path: Path, dataset: h5py.Dataset, shape: Sequence[int | None], dtype: str
) -> None:
    found = dataset.shape or ()  # An empty data space has none.
    is_shape = len(found) == len(shape) and all(
        want is None or want == got for want, got in zip(shape, found, strict=True)
    )
    if not is_shape or dataset.dtype != np.dtype(dtype):
        wanted = tuple("any" if size is None else size for size in shape)
        raise DamagedEpisodeError(
            path,
            f"{dataset.name} must be {dtype} of shape {wanted}; got {dataset.dtype} of {found}",
        )


def _check_stored(path: Path, dataset: h5py.Dataset) -> None:
    """Refuse arrays that were declared but not written: they would fill the memory."""
    stored, chunk = int(dataset.id.get_storage_size()), math.prod(dataset.chunks or (0,))
    if chunk * dataset.dtype.itemsize > MAX_CHUNK_BYTES:
        raise DamagedEpisodeError(
            path, f"{dataset.name} must have chunks of at most {MAX_CHUNK_BYTES} bytes"
        )
    if dataset.nbytes > MAX_COMPRESSION * stored:
        raise DamagedEpisodeError(
            path,
            f"{dataset.name} declares {dataset.nbytes} bytes, of shape {dataset.shape}, but "
            f"holds {stored}",
        )


def _read_integer(path: Path, node: h5py.Group, name: str, default: int | None = None) -> int:
    value = _read_attribute(path, node, name, default)
    if not isinstance(value, (int, np.integer)) or isinstance(value, bool):
        raise DamagedEpisodeError(
            path, f"attribute {name} must be a whole number; got {_tell(value)}"
        )
    return int(value)


def _read_truth(path: Path, node: h5py.Group, name: str) -> bool:
    value = _read_attribute(path, node, name, None)
    if not isinstance(value, (bool, np.bool_)):
        raise DamagedEpisodeError(
            path, f"attribute {name} must be true or false; got {_tell(value)}"
        )
    return bool(value)


def _read_text(path: Path, node: h5py.Group, name: str, default: str) -> str:
    value = _read_attribute(path, node, name, default)
    if not isinstance(value, str) or len(value) > MAX_TEXT:
        raise DamagedEpisodeError(
            path,
            f"attribute {name} must be a text of at most {MAX_TEXT} characters; got {_tell(value)}",
        )
    return value


def _read_attribute(path: Path, node: h5py.Group, name: str, default: object) -> object:
    if name not in node.attrs:
        if default is None:
            raise DamagedEpisodeError(path, f"no attribute {name}")
        return default
    shape = node.attrs.get_id(name).shape
    if shape != ():
        raise DamagedEpisodeError(
            path, f"attribute {name} must be one value; got an array of shape {shape}"
        )
    return node.attrs[name]


def _tell(value: object) -> str:
    return show(value.item() if isinstance(value, np.generic) else value)
