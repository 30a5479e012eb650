"""Episode files: one attempt, one HDF5 file; the format is `docs/episode_format.md`."""

import io
import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import MISSING, dataclass, field, fields
from pathlib import Path
from typing import Annotated, Any, ClassVar, TypeAlias, TypeVar

import h5py
import numpy as np
from annotated_types import Ge, Len
from pydantic import AfterValidator, ConfigDict

from dgl_collect.errors import CorruptEpisodeError
from dgl_collect.files import unavailable_told
from dgl_collect.options import CloudKind
from dgl_files.fields import STRICT, check_fields, check_value, decode_json
from dgl_files.whole import write_bytes

N = TypeVar("N", h5py.Group, h5py.Dataset)

FORMAT_VERSION = 1
DEFAULT_ROBOT = "ur10e+shadow"
"""The robot of files that name none."""
DEFAULT_MATCHER = "exact"
"""The matcher of files that name none."""
DEFAULT_CLOUD: CloudKind = "segmented"
"""The kind of `env_point_cloud` of files that name none."""
DEFAULT_JOINTS = 60
"""Number of joints of the default robot."""
FINAL_PARTICLES = "final_particles"
"""Extra array: the garment's particles when it was judged [m], shape (V, 3)."""
MAX_BYTES = 4_000_000_000
"""Limit for all arrays of an episode; a minute of recorded stages has about 1.5 GB of pictures."""
CLOUD_SIZE = 2048
IMAGE_HEIGHT, IMAGE_WIDTH = 480, 640


def _check_point(point: Mapping[str, Sequence[float]]) -> Mapping[str, Sequence[float]]:
    lengths = {"xyz": 3, "uv": 2}
    for key, value in point.items():
        if len(value) != lengths.get(key):
            raise ValueError(f"a point must hold xyz (3,) or uv (2,); got {key}={list(value)}")
    return point


Points: TypeAlias = Mapping[
    str, Annotated[Mapping[str, Sequence[float]], AfterValidator(_check_point)]
]
"""Points by name: position `xyz` [m], world frame; pixel `uv` (column, row) of the camera."""
_Text: TypeAlias = Annotated[str, Len(1)]
_Count: TypeAlias = Annotated[int, Ge(0)]
_CONFIG: ConfigDict = {**STRICT, "arbitrary_types_allowed": True}


_JSON = ("points", "randomisation", "measurements", "package_versions")
"""Fields that files hold as JSON text."""


@dataclass(frozen=True)
class _Layout:
    """Declaration of an array; sizes that have a name, such as T frames, are equal everywhere."""

    shape: tuple[int | str, ...]
    dtype: str
    chunk: int
    """Frames in a chunk of the file."""


def _layout(*shape: int | str, dtype: str = "float32", chunk: int = 8) -> Mapping[str, _Layout]:
    """Make the metadata of a field; eight frames are the length of a training window."""
    return {"layout": _Layout(shape, dtype, chunk)}


@dataclass(frozen=True, kw_only=True, eq=False)
class StageRecord:
    """Recording of one stage: T frames, and what does not change within it.

    Arrays are float32 unless stated, in metres and radians, world frame, quaternions wxyz. Other
    types are refused rather than converted, so that reading gives what was written.

    Raises:
        ValueError: If a field has another shape or type, is not finite, or out of its range.
    """

    __pydantic_config__: ClassVar = _CONFIG

    name: _Text
    """The stage's name in the task's demonstration."""
    joint_state: np.ndarray = field(metadata=_layout("T", "D", chunk=64))
    """Measured joint positions [rad], shape (T, D), D joints of the robot: 60 by default."""
    action: np.ndarray = field(metadata=_layout("T", "D", chunk=64))
    """Commanded joint targets [rad], shape (T, D)."""
    ee_pose: np.ndarray = field(metadata=_layout("T", 2, 7, chunk=64))
    """Left and right end effector, position [m] and unit quaternion wxyz, shape (T, 2, 7)."""
    image: np.ndarray = field(
        metadata=_layout("T", IMAGE_HEIGHT, IMAGE_WIDTH, 3, dtype="uint8", chunk=1)
    )
    """Environment camera, RGB, shape (T, 480, 640, 3), uint8."""
    env_point_cloud: np.ndarray = field(metadata=_layout("T", CLOUD_SIZE, 6))
    """Position [m] and colour in [0, 1], shape (T, 2048, 6)."""
    garment_point_cloud: np.ndarray = field(metadata=_layout(CLOUD_SIZE, 3))
    """The garment when the stage begins [m], shape (2048, 3)."""
    points_affordance_feature: np.ndarray = field(metadata=_layout(CLOUD_SIZE, 2))
    """Affordance for the left and the right hand in [0, 1], shape (2048, 2)."""
    object_point_cloud: np.ndarray | None = field(default=None, metadata=_layout(CLOUD_SIZE, 3))
    """The object when the stage begins [m], shape (2048, 3); None in tasks without one."""
    points: Points = field(default_factory=dict)
    """The points found on the garment."""
    cloud_step: _Count | None = None
    """Control steps between the reset and the garment's cloud; None in files without commands."""
    first_step: _Count | None = None
    """Control steps between the reset and the first frame; None in files without commands."""
    approach_frames: _Count = 0
    """Number of frames, the first ones, that show the hands on their way to the grasp points."""

    def __post_init__(self) -> None:
        check_fields(self)
        _check_arrays(self)
        if not self.approach_frames < self.frame_count:
            raise ValueError(
                f"approach_frames must be fewer than the {self.frame_count} frames; "
                f"got {self.approach_frames}"
            )
        _check_range("points_affordance_feature", self.points_affordance_feature)
        _check_range("colour of env_point_cloud", self.env_point_cloud[..., 3:])
        norms = np.linalg.norm(self.ee_pose[..., 3:], axis=-1)
        if np.abs(norms - 1.0).max() > 1e-3:
            worst = norms.flat[np.abs(norms - 1.0).argmax()]
            raise ValueError(f"ee_pose must hold unit quaternions; got one of length {worst:.4g}")

    @property
    def frame_count(self) -> int:
        """Number of recorded frames, T."""
        return len(self.joint_state)


@dataclass(frozen=True, kw_only=True, eq=False)
class Episode:
    """The recording of one attempt.

    Raises:
        ValueError: If a field is of another type, an array of another shape, or a value not finite.
    """

    __pydantic_config__: ClassVar = _CONFIG

    task: _Text
    """Environment id, such as `FoldTops-v1`."""
    seed: int
    """Seed of this attempt."""
    garment_id: str
    """Id of the garment."""
    success: bool
    """True if the task's rule was met."""
    success_value: float
    """The quantity that the rule judges."""
    stages: Annotated[tuple[StageRecord, ...], Len(1)]
    """The stages in order."""
    robot: _Text = DEFAULT_ROBOT
    """Name of arm and hand; it determines the joints."""
    matcher: _Text = DEFAULT_MATCHER
    """Name of the matcher that found the demonstrated points on the garment."""
    affordance_matcher: str | None = None
    """Name of the matcher of the stages' affordance, if another; see `dgl_collect.relabel`."""
    cloud: CloudKind = DEFAULT_CLOUD
    """Kind of the stages' `env_point_cloud`."""
    randomisation: Mapping[str, object] = field(default_factory=dict)
    """Every draw of this attempt, JSON-ready."""
    measurements: Mapping[str, object] = field(default_factory=dict)
    """Further named numbers, such as the largest stretch, JSON-ready."""
    package_versions: Mapping[str, object] = field(default_factory=dict)
    """Package to version."""
    commands: np.ndarray | None = field(default=None, metadata=_layout("S", "D"))
    """Joint targets of all S control steps from the reset to the verdict [rad], shape (S, D),
    float32, for replays; None in files without them."""
    extra: Mapping[str, np.ndarray] = field(default_factory=dict)
    """Further numeric arrays for analysis, such as the true particles [m]."""

    def __post_init__(self) -> None:
        check_fields(self)
        joints = sorted({stage.joint_state.shape[1] for stage in self.stages})
        if len(joints) > 1:
            raise ValueError(f"all stages must have the same number of joints; got {joints}")
        if self.robot == DEFAULT_ROBOT and joints != [DEFAULT_JOINTS]:
            raise ValueError(
                f"joint_state of robot {self.robot} must have shape (T, {DEFAULT_JOINTS}); "
                f"got (T, {joints[0]})"
            )
        _check_arrays(self, D=joints[0])
        for name in _JSON[1:]:
            _to_json(name, getattr(self, name))
        for name, array in self.extra.items():
            if not name or "/" in name:
                raise ValueError(f"extra names must be non-empty and without '/'; got {name!r}")
            if array.dtype.kind not in "iufb":
                raise ValueError(f"extra {name!r} must be numeric; got dtype {array.dtype}")
            _check_finite(f"extra {name!r}", array)

    @property
    def stage_names(self) -> tuple[str, ...]:
        """Names of the stages in order."""
        return tuple(stage.name for stage in self.stages)


def write_episode(path: Path | str, episode: Episode) -> Path:
    """Write an episode, whole or not at all; the same episode gives the same bytes.

    Args:
        path: The file, ending in `.h5`; an older one is replaced.
        episode: The content.

    Returns:
        The path.
    """
    path = Path(path)
    # Fixed bounds of the format make the bytes independent of the library's default; v110 is the
    # first version whose metadata blocks carry checksums.
    # Written in memory first: HDF5 crashes where a disk is full.
    content = io.BytesIO()
    with h5py.File(content, "w", libver=("v110", "v110")) as file:
        file.attrs["format_version"] = FORMAT_VERSION
        file.attrs["stage_names"] = json.dumps(episode.stage_names)
        _write_fields(file, episode)
        for number, stage in enumerate(episode.stages, start=1):
            _write_fields(file.create_group(f"stage_{number}"), stage)
        for name in sorted(episode.extra):
            _write_array(file, f"extra/{name}", episode.extra[name])
    write_bytes(path, content.getvalue())
    return path


def read_episode(path: Path | str) -> Episode:
    """Read and check an episode.

    Args:
        path: An episode file.

    Returns:
        The episode, all arrays in memory.

    Raises:
        FileNotFoundError: If there is no such file.
        FileUnavailableError: If the file cannot be opened now: in use, or not permitted.
        CorruptEpisodeError: If the file is truncated, damaged, incomplete or of another version.
    """
    with opened_episode(path) as file:
        names = read_stage_names(file)
        groups = sorted(str(key) for key in file if str(key).startswith("stage_"))
        expected = [f"stage_{number}" for number in range(1, len(names) + 1)]
        if groups != sorted(expected):
            raise ValueError(f"stage groups must be {expected}; got {groups}")
        stages = tuple(_read_stage(take(file, key, h5py.Group)) for key in expected)
        if [stage.name for stage in stages] != names:
            raise ValueError(f"stage_names must be {[s.name for s in stages]}; got {names}")
        extra = {}
        if "extra" in file:
            group = take(file, "extra", h5py.Group)
            extra = {str(name): take(group, str(name), h5py.Dataset)[()] for name in group}
        return Episode(stages=stages, extra=extra, **_read_fields(file, Episode))


@contextmanager
def opened_episode(path: Path | str) -> Iterator[h5py.File]:
    """Open an episode; whatever is wrong with its content becomes a `CorruptEpisodeError`.

    Raises:
        FileNotFoundError, FileUnavailableError, CorruptEpisodeError: As `read_episode`.
    """
    path = Path(path)
    try:
        with unavailable_told(path):
            if not path.is_file():
                raise FileNotFoundError(f"no episode file at {path}")
            with h5py.File(path, "r") as file:
                yield file
    except FileNotFoundError:
        raise
    except (OSError, RuntimeError) as err:  # HDF5's truncated files and failed checksums
        raise CorruptEpisodeError(path, f"not a whole HDF5 file ({err})") from err
    except (ValueError, KeyError, TypeError, AttributeError) as err:
        fault = str(err.args[0]) if err.args else repr(err)
        raise CorruptEpisodeError(path, fault) from err


def find_episodes(folder: Path) -> list[Path]:
    """List the episode files of a folder, or of a run's folder, by name."""
    return sorted(folder.glob("*.h5")) or sorted(folder.glob("episodes/*.h5"))


def read_stage_names(file: h5py.File) -> list[str]:
    """Read the names of the stages; check that all data lie in the file and fit into memory.

    Raises:
        ValueError, KeyError, TypeError: If something is wrong.
    """
    version: Any = file.attrs["format_version"]
    if isinstance(version, float | np.floating) or version != FORMAT_VERSION:
        raise ValueError(f"format_version must be {FORMAT_VERSION}; got {version}")
    _check_sizes(file)
    names = decode_json(str(file.attrs["stage_names"]))
    check_value("stage_names", names, list[str])
    return names


def take(parent: h5py.Group, key: str, kind: type[N]) -> N:
    """Get a group or a data set.

    Raises:
        ValueError: If it is missing, or of the other kind.
    """
    node = parent.get(key)
    if not isinstance(node, kind):
        label = f"{str(parent.name).rstrip('/')}/{key}".lstrip("/")
        found = "is missing" if node is None else f"must be a {kind.__name__}; got {node}"
        raise ValueError(f"{label} {found}")
    return node


def _read_stage(group: h5py.Group) -> StageRecord:
    label = str(group.name).lstrip("/")
    unknown = sorted({str(key) for key in group} - {item.name for item in fields(StageRecord)})
    if unknown:
        raise ValueError(f"{label} holds unknown keys: {unknown}")
    found = _read_fields(group, StageRecord)
    try:
        return StageRecord(**found)
    except ValueError as err:
        raise ValueError(f"{label}: {err}") from err


def _read_fields(group: h5py.Group, kind: type[StageRecord | Episode]) -> dict[str, Any]:
    """Read the fields that are there: arrays from data sets, everything else from attributes."""
    found: dict[str, Any] = {}
    for item in fields(kind):
        name = item.name
        if "layout" in item.metadata:
            if name in group or item.default is MISSING:
                found[name] = take(group, name, h5py.Dataset)[()]
        elif name in group.attrs:
            value: Any = group.attrs[name]
            value = value.item() if isinstance(value, np.generic) else value
            found[name] = decode_json(value) if name in _JSON else value
    return found


def _write_fields(group: h5py.Group, record: StageRecord | Episode) -> None:
    """Write arrays as data sets, everything else as attributes; stages and extras are left out."""
    for item in fields(record):
        name, value, layout = item.name, getattr(record, item.name), item.metadata.get("layout")
        if value is None or name in ("stages", "extra"):
            continue
        if layout is None:
            group.attrs[name] = _to_json(name, value) if name in _JSON else value
        else:
            frames = min(layout.chunk, len(value)) if layout.shape[0] == "T" else len(value)
            _write_array(group, name, value, chunks=(frames, *value.shape[1:]))


def _write_array(
    group: h5py.Group, key: str, array: np.ndarray, *, chunks: tuple[int, ...] | None = None
) -> None:
    """Write an array compressed and with checksums; gzip because every HDF5 build can read it."""
    if array.size == 0 or array.ndim == 0:
        group.create_dataset(key, data=array, track_times=False)
        return
    group.create_dataset(
        key,
        data=array,
        chunks=chunks if chunks is not None else True,
        compression="gzip",
        compression_opts=1,
        shuffle=True,
        fletcher32=True,
        track_times=False,
    )


def _check_sizes(file: h5py.File) -> None:
    """Check, before anything is read, that all data are in the file itself and fit into memory."""
    total = 0

    def visit(group: h5py.Group) -> None:
        nonlocal total
        for key in group:
            label = f"{str(group.name).rstrip('/')}/{key}".lstrip("/")
            if not isinstance(group.get(key, getlink=True), h5py.HardLink):
                raise TypeError(f"{label} must be in the file itself; got a link")
            node = group[key]
            if isinstance(node, h5py.Group):
                visit(node)
            elif isinstance(node, h5py.Dataset):
                if node.is_virtual or node.external:
                    raise TypeError(f"{label} must be in the file itself; got data of other files")
                if node.dtype.kind not in "iufb":
                    raise TypeError(f"{label} must be numeric; got dtype {node.dtype}")
                total += node.size * node.dtype.itemsize
                if total > MAX_BYTES:
                    raise ValueError(
                        f"the arrays must have at most {MAX_BYTES / 1e9:g} GB in all; "
                        f"{label}, of shape {node.shape}, exceeds that"
                    )

    visit(file)


def _check_arrays(record: StageRecord | Episode, **sizes: int) -> None:
    """Check the arrays of a record against their layouts; named sizes may be known before."""
    for item in fields(record):
        name, array, layout = item.name, getattr(record, item.name), item.metadata.get("layout")
        if layout is None or array is None:
            continue
        for wanted, size in zip(layout.shape, array.shape, strict=False):
            if isinstance(wanted, str):
                sizes.setdefault(wanted, size)
        shape = tuple(sizes.get(str(size), size) for size in layout.shape)
        if array.shape != shape:
            told = ", ".join(map(str, shape))
            raise ValueError(f"{name} must have shape ({told}); got {array.shape}")
        if 0 in shape:
            raise ValueError(f"{name} must have at least one frame and joint; got shape {shape}")
        if array.dtype != np.dtype(layout.dtype):
            raise ValueError(f"{name} must be {layout.dtype}; got {array.dtype}")
        _check_finite(name, array)


def _to_json(name: str, value: object) -> str:
    try:
        return json.dumps(value, sort_keys=True, ensure_ascii=False, allow_nan=False)
    except (TypeError, ValueError) as err:
        raise ValueError(f"{name} must be JSON-ready with finite numbers; {err}") from err


def _check_finite(name: str, array: np.ndarray) -> None:
    if array.dtype.kind == "f" and not np.isfinite(array).all():
        bad = int(array.size - np.isfinite(array).sum())
        raise ValueError(f"{name} must be finite; got {bad} values that are not")


def _check_range(name: str, array: np.ndarray) -> None:
    low, high = float(array.min()), float(array.max())
    if low < 0.0 or high > 1.0:
        raise ValueError(f"{name} must lie in [0, 1]; got [{low:.4g}, {high:.4g}]")
