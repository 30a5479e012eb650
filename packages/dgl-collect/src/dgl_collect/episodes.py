"""Episode files: one demonstration, one HDF5 file; the format is `docs/episode_format.md`."""

from __future__ import annotations

import io
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from dgl_collect.errors import CorruptEpisodeError
from dgl_files.fields import decode_json
from dgl_files.whole import write_bytes

FORMAT_VERSION = 1
DEFAULT_ROBOT = "ur10e+shadow"
"""The robot of files that name none."""
DEFAULT_MATCHER = "exact"
"""The matcher of files that name none."""
DEFAULT_JOINTS = 60
"""Number of its joints."""
FINAL_PARTICLES = "final_particles"
"""Extra array: the garment's particles when it was judged [m], shape (V, 3)."""
MAX_BYTES = 4_000_000_000
"""Most bytes that the arrays of an episode may have in all; a minute of recorded stages has about 1.5 GB of pictures."""
CLOUD_SIZE = 2048
IMAGE_HEIGHT, IMAGE_WIDTH = 480, 640

Points = Mapping[str, Mapping[str, Sequence[float]]]
"""Named points: position `xyz` [m], shape (3,), world frame; pixel `uv` (column, row), shape (2,)."""


@dataclass(frozen=True)
class _Key:
    """Declaration of one data set of a stage."""

    shape: tuple[int, ...]  # without the frame axis; 0 stands for the number of the robot's joints
    dtype: str = "float32"
    per_frame: bool = True
    optional: bool = False
    frames_a_chunk: int = 8  # the length of a training window


_STAGE_KEYS: dict[str, _Key] = {
    "joint_state": _Key((0,), frames_a_chunk=64),
    "action": _Key((0,), frames_a_chunk=64),
    "ee_pose": _Key((2, 7), frames_a_chunk=64),
    "image": _Key((IMAGE_HEIGHT, IMAGE_WIDTH, 3), dtype="uint8", frames_a_chunk=1),
    "env_point_cloud": _Key((CLOUD_SIZE, 6)),
    "garment_point_cloud": _Key((CLOUD_SIZE, 3), per_frame=False),
    "points_affordance_feature": _Key((CLOUD_SIZE, 2), per_frame=False),
    "object_point_cloud": _Key((CLOUD_SIZE, 3), per_frame=False, optional=True),
}


_STEP_KEYS = ("cloud_step", "first_step")


@dataclass(frozen=True, kw_only=True, eq=False)
class StageRecord:
    """What was recorded in one stage: T frames, and what does not change within it.

    Arrays are float32 unless stated, in metres and radians, world frame, quaternions wxyz. Other
    types are refused rather than converted, so that what is read back is what was given.

    Raises:
        ValueError: If an array has another shape or type, is not finite, or out of its range.
    """

    name: str
    """The stage's name in the task's declaration."""
    joint_state: np.ndarray
    """Measured joint positions [rad], shape (T, D), D joints of the robot: 60 by default."""
    action: np.ndarray
    """Commanded joint targets [rad], shape (T, D)."""
    ee_pose: np.ndarray
    """Left and right end effector, position [m] and unit quaternion wxyz, shape (T, 2, 7)."""
    image: np.ndarray
    """Environment camera, RGB, shape (T, 480, 640, 3), uint8."""
    env_point_cloud: np.ndarray
    """Position [m] and colour in [0, 1], shape (T, 2048, 6)."""
    garment_point_cloud: np.ndarray
    """The garment when the stage begins [m], shape (2048, 3)."""
    points_affordance_feature: np.ndarray
    """Affordance for the left and the right hand in [0, 1], shape (2048, 2)."""
    object_point_cloud: np.ndarray | None = None
    """The object when the stage begins [m], shape (2048, 3); None in tasks without one."""
    points: Points = field(default_factory=dict)
    """The points found on the garment."""
    cloud_step: int | None = None
    """Control steps between the reset and the garment's cloud; None in files that do not tell."""
    first_step: int | None = None
    """Control steps between the reset and the first frame; None in files that do not tell."""
    approach_frames: int = 0
    """How many of the frames, the first ones, show the hands on their way to the grasp points."""

    def __post_init__(self) -> None:
        if not self.name:
            raise ValueError("name must not be empty; got ''")
        for key in _STEP_KEYS:
            step = getattr(self, key)
            if step is not None and step < 0:
                raise ValueError(f"{key} must be at least 0; got {step}")
        if not 0 <= self.approach_frames < max(1, len(self.joint_state)):
            raise ValueError(
                f"approach_frames must be at least 0 and fewer than the {len(self.joint_state)} frames; "
                f"got {self.approach_frames}"
            )
        arrays = {key: getattr(self, key) for key in _STAGE_KEYS}
        _check_stage({key: array for key, array in arrays.items() if array is not None})
        _check_points(self.points)

    @property
    def frame_count(self) -> int:
        """Number of recorded frames, T."""
        return len(self.joint_state)


@dataclass(frozen=True, kw_only=True, eq=False)
class Episode:
    """One demonstration.

    Raises:
        ValueError: If there is no stage, an extra is not numeric and finite, or a value is not finite.
    """

    task: str
    """Environment id, such as `FoldTops-v1`."""
    seed: int
    """Seed of this attempt."""
    garment_id: str
    """Which garment."""
    success: bool
    """Whether the task's own rule was met."""
    success_value: float
    """The quantity that the rule judges."""
    stages: tuple[StageRecord, ...]
    """The stages in order."""
    robot: str = DEFAULT_ROBOT
    """Name of arm and hand, which says what the joints are."""
    matcher: str = DEFAULT_MATCHER
    """Name of what found the demonstrated points on the garment."""
    affordance_matcher: str | None = None
    """Name of what the stages' affordance is from, where that is not the same; see `dgl_collect.relabel`."""
    randomisation: Mapping[str, object] = field(default_factory=dict)
    """Every draw of this attempt, JSON-ready."""
    measurements: Mapping[str, object] = field(default_factory=dict)
    """Further named numbers, such as the largest stretch, JSON-ready."""
    package_versions: Mapping[str, str] = field(default_factory=dict)
    """Name to version of what produced the episode."""
    commands: np.ndarray | None = None
    """Joint targets of all S control steps from the reset to the verdict [rad], shape (S, D), float32,
    from which the attempt can be replayed; None in files that do not hold them."""
    extra: Mapping[str, np.ndarray] = field(default_factory=dict)
    """Further numeric arrays for analysis, such as the true particles [m]."""

    def __post_init__(self) -> None:
        if not self.task:
            raise ValueError("task must not be empty; got ''")
        if not self.stages:
            raise ValueError("stages must hold at least one stage; got none")
        if not self.robot:
            raise ValueError("robot must not be empty; got ''")
        if not self.matcher:
            raise ValueError("matcher must not be empty; got ''")
        joints = sorted({stage.joint_state.shape[1] for stage in self.stages})
        if len(joints) > 1:
            raise ValueError(f"all stages must have the same number of joints; got {joints}")
        if self.robot == DEFAULT_ROBOT and joints != [DEFAULT_JOINTS]:
            raise ValueError(
                f"joint_state of robot {self.robot} must have shape (T, {DEFAULT_JOINTS}); "
                f"got (T, {joints[0]})"
            )
        if self.commands is not None:
            self._check_commands(self.commands, joints[0])
        if not np.isfinite(self.success_value):
            raise ValueError(f"success_value must be finite; got {self.success_value}")
        for name in ("randomisation", "measurements", "package_versions"):
            _to_json(name, getattr(self, name))
        for name, array in self.extra.items():
            if not name or "/" in name:
                raise ValueError(f"extra names must be non-empty and without '/'; got {name!r}")
            if array.dtype.kind not in "iufb":
                raise ValueError(f"extra {name!r} must be numeric; got dtype {array.dtype}")
            _check_finite(f"extra {name!r}", array)

    @staticmethod
    def _check_commands(commands: np.ndarray, joints: int) -> None:
        if commands.ndim != 2 or commands.shape[1] != joints or commands.dtype != np.float32:
            raise ValueError(
                f"commands must have shape (S, {joints}) and dtype float32; "
                f"got {commands.shape} {commands.dtype}"
            )
        _check_finite("commands", commands)

    @property
    def stage_names(self) -> tuple[str, ...]:
        """Names of the stages in order."""
        return tuple(stage.name for stage in self.stages)


def write_episode(path: Path | str, episode: Episode) -> Path:
    """Write an episode, beside its place and renamed; the same episode gives the same bytes.

    Args:
        path: Where the file belongs, ending in `.h5`; an older file there is replaced.
        episode: What to write.

    Returns:
        The path.
    """
    path = Path(path)
    # Fixed bounds of the library's own format make the bytes independent of its default, and v110 is
    # the first whose metadata blocks carry checksums.
    # Written in memory first: HDF5 crashes where a disk is full.
    content = io.BytesIO()
    with h5py.File(content, "w", libver=("v110", "v110")) as file:
        file.attrs["format_version"] = FORMAT_VERSION
        file.attrs["task"] = episode.task
        file.attrs["seed"] = episode.seed
        file.attrs["garment_id"] = episode.garment_id
        file.attrs["robot"] = episode.robot
        file.attrs["matcher"] = episode.matcher
        if episode.affordance_matcher is not None:
            file.attrs["affordance_matcher"] = episode.affordance_matcher
        file.attrs["success"] = np.bool_(episode.success)
        file.attrs["success_value"] = float(episode.success_value)
        file.attrs["stage_names"] = json.dumps(episode.stage_names)
        for name in ("randomisation", "measurements", "package_versions"):
            file.attrs[name] = _to_json(name, getattr(episode, name))
        for number, stage in enumerate(episode.stages, start=1):
            _write_stage(file.create_group(f"stage_{number}"), stage)
        if episode.commands is not None:
            _write_array(file, "commands", episode.commands)
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
        CorruptEpisodeError: If the file is truncated, damaged, incomplete or of another version.
    """
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"no episode file at {path}")
    try:
        with h5py.File(path, "r") as file:
            return _read_file(file)
    except (OSError, RuntimeError) as err:  # how HDF5 reports truncated files and failed checksums
        raise CorruptEpisodeError(path, f"not a whole HDF5 file ({err})") from err
    except (ValueError, KeyError, TypeError, AttributeError) as err:
        fault = str(err.args[0]) if err.args else repr(err)
        raise CorruptEpisodeError(path, fault) from err


def _write_stage(group: h5py.Group, stage: StageRecord) -> None:
    group.attrs["name"] = stage.name
    group.attrs["points"] = _to_json("points", stage.points)
    for key in _STEP_KEYS:
        if getattr(stage, key) is not None:
            group.attrs[key] = getattr(stage, key)
    if stage.approach_frames:
        group.attrs["approach_frames"] = stage.approach_frames
    for key, declared in _STAGE_KEYS.items():
        array = getattr(stage, key)
        if array is None:
            continue
        chunks = array.shape
        if declared.per_frame:
            chunks = (min(declared.frames_a_chunk, len(array)), *array.shape[1:])
        _write_array(group, key, array, chunks=chunks)


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


def read_stage_names(file: h5py.File) -> list[str]:
    """Read the names of an episode's stages, and check that its arrays are its own and fit into memory.

    Raises:
        ValueError, KeyError, TypeError: If something is wrong.
    """
    version = _integer(file, "format_version")
    if version != FORMAT_VERSION:
        raise ValueError(f"format_version must be {FORMAT_VERSION}; got {version}")
    _check_sizes(file)
    return _json_attribute(file, "stage_names", list)


def _read_file(file: h5py.File) -> Episode:
    names = read_stage_names(file)
    groups = [str(key) for key in file if str(key).startswith("stage_")]
    expected = [f"stage_{number}" for number in range(1, len(names) + 1)]
    if sorted(groups) != sorted(expected):
        raise ValueError(f"stage groups must be {expected}; got {sorted(groups)}")
    stages = tuple(_read_stage(_group(file, key)) for key in expected)
    if [stage.name for stage in stages] != names:
        raise ValueError(f"stage_names must be {[s.name for s in stages]}; got {names}")
    extra: dict[str, np.ndarray] = {}
    if "extra" in file:
        group = _group(file, "extra")
        extra = {str(name): _array(group, str(name)) for name in group}
    return Episode(
        task=_text(file, "task"),
        seed=_integer(file, "seed"),
        garment_id=_text(file, "garment_id"),
        robot=_text(file, "robot") if "robot" in file.attrs else DEFAULT_ROBOT,
        matcher=_text(file, "matcher") if "matcher" in file.attrs else DEFAULT_MATCHER,
        affordance_matcher=(
            _text(file, "affordance_matcher") if "affordance_matcher" in file.attrs else None
        ),
        success=_truth(file, "success"),
        success_value=_number(file, "success_value"),
        stages=stages,
        randomisation=_json_attribute(file, "randomisation", dict),
        measurements=_json_attribute(file, "measurements", dict),
        package_versions=_json_attribute(file, "package_versions", dict),
        commands=_array(file, "commands") if "commands" in file else None,
        extra=extra,
    )


def _read_stage(group: h5py.Group) -> StageRecord:
    label = str(group.name).lstrip("/")
    missing = [k for k, d in _STAGE_KEYS.items() if not d.optional and k not in group]
    if missing:
        raise KeyError(f"{label}/{missing[0]} is missing")
    _check_shapes(group)
    arrays = {key: _array(group, key) for key in _STAGE_KEYS if key in group}
    unknown = sorted({str(key) for key in group} - set(_STAGE_KEYS))
    if unknown:
        raise ValueError(f"{label} holds unknown keys: {unknown}")
    try:
        return StageRecord(
            name=_text(group, "name"),
            points=_json_attribute(group, "points", dict),
            cloud_step=_step(group, "cloud_step"),
            first_step=_step(group, "first_step"),
            approach_frames=_step(group, "approach_frames") or 0,
            **arrays,
        )
    except ValueError as err:
        raise ValueError(f"{label}: {err}") from err


def _step(group: h5py.Group, name: str) -> int | None:
    return _integer(group, name) if name in group.attrs else None


def _group(parent: h5py.Group, key: str) -> h5py.Group:
    node = parent[key]
    if not isinstance(node, h5py.Group):
        raise TypeError(f"{key} must be a group; got {type(node).__name__}")
    return node


def _array(parent: h5py.Group, key: str) -> np.ndarray:
    node = parent[key]
    if not isinstance(node, h5py.Dataset):
        raise TypeError(f"{key} must be a data set; got {type(node).__name__}")
    return node[()]


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


def _check_shapes(group: h5py.Group) -> None:
    """Check types and shapes of a stage's arrays before they are read."""
    label = str(group.name).lstrip("/")
    shapes = {key: group[key] for key in _STAGE_KEYS if key in group}
    for key, node in shapes.items():
        if not isinstance(node, h5py.Dataset):
            raise TypeError(f"{label}/{key} must be a data set; got {type(node).__name__}")
    frames = shapes["joint_state"].shape[:1]
    for key, node in shapes.items():
        declared = _STAGE_KEYS[key]
        start = frames if declared.per_frame else ()
        one = node.shape[len(start) :]
        fits = len(one) == len(declared.shape) and all(
            wanted in (0, size) for wanted, size in zip(declared.shape, one, strict=True)
        )
        if node.shape[: len(start)] != start or not fits:
            wanted = (*start, *(size or "D" for size in declared.shape))
            raise ValueError(f"{label}/{key} must have shape {wanted}; got {node.shape}")
        if node.dtype != np.dtype(declared.dtype):
            raise ValueError(f"{label}/{key} must be {declared.dtype}; got {node.dtype}")


def _text(node: h5py.Group, name: str) -> str:
    value = _attribute(node, name)
    if not isinstance(value, str):
        raise TypeError(f"attribute {name!r} must be a text; got {value!r}")
    return value


def _integer(node: h5py.Group, name: str) -> int:
    value = _attribute(node, name)
    if not isinstance(value, (int, np.integer)) or isinstance(value, (bool, np.bool_)):
        raise TypeError(f"attribute {name!r} must be an integer; got {value!r}")
    return int(value)


def _number(node: h5py.Group, name: str) -> float:
    value = _attribute(node, name)
    if not isinstance(value, (float, np.floating)):
        raise TypeError(f"attribute {name!r} must be a number; got {value!r}")
    return float(value)


def _truth(node: h5py.Group, name: str) -> bool:
    value = _attribute(node, name)
    if not isinstance(value, (bool, np.bool_)):
        raise TypeError(f"attribute {name!r} must be true or false; got {value!r}")
    return bool(value)


def _attribute(node: h5py.Group, name: str) -> Any:
    if name not in node.attrs:
        raise KeyError(f"attribute {name!r} of {node.name} is missing")
    return node.attrs[name]


def _json_attribute(node: h5py.Group, name: str, kind: type) -> Any:
    value = decode_json(_text(node, name))
    if not isinstance(value, kind):
        raise TypeError(f"attribute {name!r} must be a JSON {kind.__name__}; got {value!r}")
    return value


def _to_json(name: str, value: object) -> str:
    try:
        return json.dumps(value, sort_keys=True, ensure_ascii=False, allow_nan=False)
    except (TypeError, ValueError) as err:
        raise ValueError(f"{name} must be JSON-ready with finite numbers; {err}") from err


def _check_stage(arrays: Mapping[str, np.ndarray]) -> None:
    """Check types, shapes and values of one stage's arrays."""
    frame_count = len(arrays["joint_state"])
    if frame_count < 1:
        raise ValueError("joint_state must hold at least one frame; got 0")
    joints = arrays["joint_state"].shape[1] if arrays["joint_state"].ndim == 2 else 1
    for key, array in arrays.items():
        declared = _STAGE_KEYS[key]
        one = tuple(size or max(joints, 1) for size in declared.shape)
        shape = (frame_count, *one) if declared.per_frame else one
        if array.shape != shape:
            raise ValueError(f"{key} must have shape {shape}; got {array.shape}")
        if array.dtype != np.dtype(declared.dtype):
            raise ValueError(f"{key} must be {declared.dtype}; got {array.dtype}")
        _check_finite(key, array)
    _check_range("points_affordance_feature", arrays["points_affordance_feature"])
    _check_range("colour of env_point_cloud", arrays["env_point_cloud"][..., 3:])
    norms = np.linalg.norm(arrays["ee_pose"][..., 3:], axis=-1)
    if np.abs(norms - 1.0).max() > 1e-3:
        worst = norms.flat[np.abs(norms - 1.0).argmax()]
        raise ValueError(f"ee_pose must hold unit quaternions; got one of length {worst:.4g}")


def _check_finite(name: str, array: np.ndarray) -> None:
    if array.dtype.kind == "f" and not np.isfinite(array).all():
        bad = int(array.size - np.isfinite(array).sum())
        raise ValueError(f"{name} must be finite; got {bad} values that are not")


def _check_range(name: str, array: np.ndarray) -> None:
    low, high = float(array.min()), float(array.max())
    if low < 0.0 or high > 1.0:
        raise ValueError(f"{name} must lie in [0, 1]; got [{low:.4g}, {high:.4g}]")


def _check_points(points: Points) -> None:
    lengths = {"xyz": 3, "uv": 2}
    for name, point in points.items():
        for key, value in point.items():
            if key not in lengths or len(value) != lengths[key]:
                raise ValueError(f"point {name!r} must hold xyz (3,) or uv (2,); got {key}={value}")
    _to_json("points", points)
