"""File of one garment: its states, and views with the vertex of each point."""

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from annotated_types import Len

from dgl_files.fields import check_value, decode_json, show, tell
from dgl_files.tensors import TensorFile, open_tensors, write_tensors
from dgl_gam.config import check_category
from dgl_gam.errors import DataError

__all__ = [
    "FACING",
    "FORMAT_VERSION",
    "VIEW_POINTS",
    "GarmentData",
    "GarmentHeader",
    "get_state_kind",
    "read_garment",
    "read_header",
    "write_garment",
]

FORMAT_VERSION = "2"
MAX_BYTES = 2**30
"""Of a file's arrays."""
VIEW_POINTS = 2048
FACING = ("hung_one", "hung_two")
"""Kinds of states that hang with the front towards -y, whichever end is up, instead of lying."""
_NUMBERED = re.compile(r"_\d+$")
_SPLITS = ("train", "test")
_TENSORS: dict[str, tuple[tuple[str | int, ...], tuple[str, ...]]] = {
    "canonical": (("V", 3), ("F32",)),
    "states": (("S", "V", 3), ("F16", "F32")),
    "faces": (("F", 3), ("I32",)),
    "landmarks": (("K",), ("I32",)),
    "view_points": (("W", VIEW_POINTS, 3), ("F32",)),
    "view_vertices": (("W", VIEW_POINTS), ("I32",)),
    "view_state": (("W",), ("I32",)),
}
_DTYPES = {"F16": np.float16, "F32": np.float32, "I32": np.int32}
_STRINGS = ("format_version", "category", "garment_id", "split", "seed")
_Name = Annotated[str, Len(0, 200)]
_JSON: dict[str, Any] = {
    "state_names": list[_Name],
    "landmark_names": list[_Name],
    "view_directions": list[Annotated[list[float], Len(3, 3)]],
    "generator_versions": dict[str, _Name],
}


def get_state_kind(name: str) -> str:
    """Return the kind of a state: "dropped" for "dropped_3"."""
    return _NUMBERED.sub("", name)


@dataclass(frozen=True, kw_only=True)
class GarmentHeader:
    """Header of a garment's file; read without its arrays."""

    path: Path
    """The file."""
    category: str
    """Category, such as "Tops_LongSleeve"."""
    garment_id: str
    """Id within the data set."""
    split: str
    """"train" or "test"."""
    state_names: tuple[str, ...]
    """Names of the S states; the first is "flat"."""
    landmark_names: tuple[str, ...]
    """Names of the K landmarks."""
    view_directions: tuple[tuple[float, float, float], ...]
    """Unit vectors towards the camera, one for each of the W views, world frame."""
    generator_versions: Mapping[str, str]
    """Packages that made the file, with their versions."""
    seed: int
    """Seed that the file was made from."""
    shapes: Mapping[str, tuple[int, ...]]
    """Shape of each array."""

    @property
    def state_kinds(self) -> tuple[str, ...]:
        """Kind of each state, shape (S,)."""
        return tuple(get_state_kind(name) for name in self.state_names)


@dataclass(frozen=True, kw_only=True, eq=False)
class GarmentData:
    """A garment with its states and views. Lengths in metres, world frame z up."""

    header: GarmentHeader
    """Header of the file."""
    canonical: np.ndarray
    """Canonical coordinates, shape (V, 3), float32: equal places of a category have equal ones. The
    third is the side: +1 front, -1 back, 0 on a seam. All NaN if the garment has none: then only
    its own states correspond."""
    states: np.ndarray
    """Positions of the vertices in each state [m], shape (S, V, 3), float32. The first is flat, in
    the garment frame: neck towards +y, left at -x."""
    faces: np.ndarray
    """Triangles, shape (F, 3), int32."""
    landmarks: np.ndarray
    """Vertex of each landmark, shape (K,), int32."""
    view_points: np.ndarray
    """Visible points of each view [m], shape (W, 2048, 3), float32, world frame."""
    view_vertices: np.ndarray
    """Nearest vertex of each visible point, shape (W, 2048), int32."""
    view_state: np.ndarray
    """State that each view shows, shape (W,), int32."""
    nbytes: int = field(default=0)
    """Memory that the arrays take."""

    @property
    def has_canonical(self) -> bool:
        """Return whether the garment has canonical coordinates."""
        return bool(np.isfinite(self.canonical).all())

    @property
    def diagonal(self) -> float:
        """Horizontal diagonal of the bounding box while it lies flat [m]."""
        return float(np.linalg.norm(np.ptp(self.states[0, :, :2], axis=0)))

    def get_views(self, kind: str) -> np.ndarray:
        """Find the views of a kind of state."""
        kinds = self.header.state_kinds
        return np.flatnonzero([kinds[s] == kind for s in self.view_state])


def read_header(path: Path) -> GarmentHeader:
    """Read and check what a garment's file says about itself, without its arrays.

    Raises:
        DataError: If the file is missing, damaged, of another format, or contradicts itself.
    """
    with open_tensors(Path(path), what="a garment's data", error=DataError) as file:
        return _read_header(file)


def _read_header(file: TensorFile) -> GarmentHeader:
    path, metadata = file.path, file.metadata
    _check_metadata(file)
    shapes = _check_shapes(path, file.found)
    file.check_types(tuple(_DTYPES), max_bytes=MAX_BYTES)
    values = {name: _parse(path, name, metadata[name]) for name in _JSON}
    for name, tensor, axis in (
        ("state_names", "states", 0),
        ("landmark_names", "landmarks", 0),
        ("view_directions", "view_points", 0),
    ):
        if len(values[name]) != shapes[tensor][axis]:
            raise DataError(
                f"{path}: {name} must be a list of {shapes[tensor][axis]}, one for each of "
                f"{tensor}; "
                f"got {show(values[name])}"
            )
    for name in ("state_names", "landmark_names"):
        if len(set(values[name])) != len(values[name]):
            raise DataError(f"{path}: {name} must differ from each other; got {show(values[name])}")
    if not values["state_names"] or values["state_names"][0] != "flat":
        raise DataError(f"{path}: the first state must be 'flat'; got {values['state_names'][:1]}")
    return GarmentHeader(
        path=path,
        category=metadata["category"],
        garment_id=metadata["garment_id"],
        split=metadata["split"],
        state_names=tuple(values["state_names"]),
        landmark_names=tuple(values["landmark_names"]),
        view_directions=tuple(
            (float(x), float(y), float(z)) for x, y, z in values["view_directions"]
        ),
        generator_versions=dict(values["generator_versions"]),
        seed=int(metadata["seed"]),
        shapes=shapes,
    )


def read_garment(path: Path) -> GarmentData:
    """Read and check a garment's file.

    Raises:
        DataError: If the file is missing, damaged, of another format, or an index or a value in it
            is wrong.
    """
    with open_tensors(Path(path), what="a garment's data", error=DataError) as file:
        header = _read_header(file)
        arrays = {name: array for name, array in file.read().items() if name in _TENSORS}
    arrays["states"] = arrays["states"].astype(np.float32)
    _check_values(header, arrays)
    return GarmentData(header=header, **arrays, nbytes=sum(a.nbytes for a in arrays.values()))


def write_garment(
    path: Path,
    *,
    category: str,
    garment_id: str,
    split: str,
    seed: int,
    state_names: Sequence[str],
    landmark_names: Sequence[str],
    view_directions: np.ndarray,
    generator_versions: Mapping[str, str],
    canonical: np.ndarray,
    states: np.ndarray,
    faces: np.ndarray,
    landmarks: np.ndarray,
    view_points: np.ndarray,
    view_vertices: np.ndarray,
    view_state: np.ndarray,
) -> None:
    """Write a garment's file whole, checked by reading it back.

    Args:
        path: The file, ending in .safetensors; its folder is made.
        category: Category of the garment.
        garment_id: Id within the data set.
        split: "train" or "test".
        seed: Seed that it was made from.
        state_names: Kinds of the S states, numbered where there are several ("dropped_0"); "flat"
            first.
        landmark_names: Names of the K landmarks.
        view_directions: Unit vectors towards the camera, shape (W, 3), world frame.
        generator_versions: Packages that made it, with versions.
        canonical: As in `GarmentData`, shape (V, 3).
        states: As in `GarmentData`, shape (S, V, 3); float16 is kept, all else becomes float32.
        faces: As in `GarmentData`, shape (F, 3).
        landmarks: As in `GarmentData`, shape (K,).
        view_points: As in `GarmentData`, shape (W, 2048, 3).
        view_vertices: As in `GarmentData`, shape (W, 2048).
        view_state: As in `GarmentData`, shape (W,).

    Raises:
        DataError: If what was given contradicts itself; nothing is left behind then.
    """
    path = Path(path)

    def check(partial: Path) -> None:
        try:
            read_garment(partial)
        except DataError as err:
            raise DataError(str(err).replace(str(partial), str(path))) from err

    given = {
        "canonical": canonical,
        "states": states,
        "faces": faces,
        "landmarks": landmarks,
        "view_points": view_points,
        "view_vertices": view_vertices,
        "view_state": view_state,
    }
    arrays = {}
    for name, array in given.items():
        kinds = _TENSORS[name][1]
        wanted = np.float16 if "F16" in kinds and array.dtype == np.float16 else _DTYPES[kinds[-1]]
        arrays[name] = np.ascontiguousarray(array, dtype=wanted)
    metadata = {
        "format_version": FORMAT_VERSION,
        "category": category,
        "garment_id": garment_id,
        "split": split,
        "seed": str(int(seed)),
        "state_names": json.dumps(list(state_names)),
        "landmark_names": json.dumps(list(landmark_names)),
        "view_directions": json.dumps(np.asarray(view_directions, dtype=np.float64).tolist()),
        "generator_versions": json.dumps(dict(generator_versions)),
    }
    write_tensors(path, arrays, metadata, check=check)


def _check_metadata(file: TensorFile) -> None:
    path, metadata = file.path, file.metadata
    missing = [name for name in (*_STRINGS, *_JSON) if name not in metadata]
    if missing:
        raise DataError(f"{path} is not a garment's data: its metadata lack {', '.join(missing)}")
    file.check_version("format_version", wanted=FORMAT_VERSION, earlier=("1",))
    if metadata["split"] not in _SPLITS:
        raise DataError(f"{path}: split must be train or test; got {show(metadata['split'])}")
    if not re.fullmatch(r"-?[0-9]{1,18}", metadata["seed"]):
        raise DataError(f"{path}: seed must be an integer; got {show(metadata['seed'])}")
    for name in ("category", "garment_id"):
        if not 1 <= len(metadata[name]) <= 200:
            raise DataError(
                f"{path}: {name} must not be empty, and have at most 200 characters; "
                f"got {show(metadata[name])}"
            )
    try:
        check_category(metadata["category"])
    except ValueError as err:
        raise DataError(f"{path}: {err}") from err


def _check_shapes(
    path: Path, found: Mapping[str, tuple[tuple[int, ...], str]]
) -> dict[str, tuple[int, ...]]:
    sizes: dict[str, int] = {}
    for name, (wanted, dtypes) in _TENSORS.items():
        if name not in found:
            raise DataError(
                f"{path} lacks the array {name}; it has {', '.join(map(tell, sorted(found)[:9]))}"
            )
        shape, dtype = found[name]
        text = ", ".join(map(str, wanted))
        if len(shape) != len(wanted) or dtype not in dtypes:
            raise DataError(
                f"{path}: {name} must have shape ({text}) and dtype {' or '.join(dtypes)}; "
                f"got {shape} and {dtype}"
            )
        for letter, size in zip(wanted, shape, strict=True):
            expected = letter if isinstance(letter, int) else sizes.setdefault(letter, size)
            if size != expected:
                raise DataError(
                    f"{path}: {name} must have shape ({text}) with {letter} = {expected}; got "
                    f"{shape}"
                )
    for letter in ("V", "S", "W", "F"):
        if sizes[letter] < 1:
            raise DataError(f"{path}: {letter} must be at least 1; got {sizes[letter]}")
    return {name: found[name][0] for name in _TENSORS}


def _parse(path: Path, name: str, text: str) -> Any:
    try:
        value = decode_json(text)
        check_value(name, value, _JSON[name])
    except ValueError as err:
        raise DataError(f"{path}: {name}: {err}") from err
    return value


def _check_values(header: GarmentHeader, arrays: Mapping[str, np.ndarray]) -> None:
    for name in ("states", "view_points"):
        if not np.isfinite(arrays[name]).all():
            raise DataError(f"{header.path}: {name} must be finite; got NaN or infinity")
    finite = np.isfinite(arrays["canonical"])
    if finite.any() and not finite.all():
        raise DataError(f"{header.path}: canonical must be finite, or NaN throughout")
    if np.isinf(arrays["canonical"]).any():
        raise DataError(f"{header.path}: canonical must be finite, or NaN throughout; got infinity")
    vertices, states = arrays["canonical"].shape[0], len(header.state_names)
    for name, end in (
        ("faces", vertices),
        ("landmarks", vertices),
        ("view_vertices", vertices),
        ("view_state", states),
    ):
        array = arrays[name]
        if array.size and not (array.min() >= 0 and array.max() < end):
            raise DataError(
                f"{header.path}: {name} must be in [0, {end}); got {array.min()} to {array.max()}"
            )
