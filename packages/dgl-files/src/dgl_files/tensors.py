"""Safetensors files of NumPy arrays, with checksums of the arrays and of the metadata."""

import json
import math
import zlib
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save_file

from dgl_files.fields import show, tell
from dgl_files.whole import written_beside

_CHECKSUMS = ("checksum", "metadata_checksum")
_BYTES = {"F16": 2, "F32": 4, "I32": 4}


def write_tensors(
    path: Path,
    arrays: Mapping[str, np.ndarray],
    metadata: Mapping[str, str],
    *,
    check: Callable[[Path], object] | None = None,
) -> None:
    """Write arrays and metadata with their checksums; the file appears whole.

    Args:
        path: The file, ending in .safetensors; its folder is made.
        arrays: C-contiguous arrays by name.
        metadata: Text by name.
        check: Reads the finished file before it is renamed into place; may raise.

    Raises:
        ValueError: If the path has another ending.
    """
    if path.suffix != ".safetensors":
        raise ValueError(f"path must end in .safetensors; got {path}")
    with written_beside(path) as partial:
        save_file(dict(arrays), partial, metadata=seal(metadata, arrays))
        partial.chmod(0o644)  # safetensors lets only the owner read.
        if check is not None:
            check(partial)


def seal(metadata: Mapping[str, str], arrays: Mapping[str, np.ndarray]) -> dict[str, str]:
    """Return the metadata with the checksums of metadata and arrays."""
    return {
        **metadata,
        "checksum": _compute_checksum(arrays),
        "metadata_checksum": _compute_metadata_checksum(metadata),
    }


class TensorFile:
    """An open file: metadata, shapes and types; `read` reads the arrays."""

    def __init__(self, path: Path, file: Any, what: str, error: type[Exception]) -> None:
        """Take over an open file; see `open_tensors`."""
        self.path = path
        self.metadata: dict[str, str] = dict(file.metadata() or {})
        """Text beside the arrays."""
        slices = {name: file.get_slice(name) for name in file.keys()}  # noqa: SIM118
        self.found: dict[str, tuple[tuple[int, ...], str]] = {
            name: (tuple(each.get_shape()), each.get_dtype()) for name, each in slices.items()
        }
        """Shape and type of each array, with safetensors' names of types."""
        self.type_prefix: str | None = None
        """Prefix of the types' names in the checksum; None if the file has no checksum."""
        self._file, self._what, self._error = file, what, error

    def check_format(self, wanted: str) -> None:
        """Compare the file's format with the wanted one."""
        found = self.metadata.get("format")
        if found != wanted:
            what = self._what.removeprefix("a ")
            raise self._error(
                f"{self.path} is no {what}: its format must be {wanted!r}; got {show(found)}"
            )

    def check_version(
        self, name: str = "version", *, wanted: str, earlier: Collection[str] = ()
    ) -> None:
        """Check the version and, unless it is an earlier one, the checksum of the metadata.

        Args:
            name: Name of the version in the metadata.
            wanted: Version of files with checksums.
            earlier: Versions of files without.
        """
        version = self.metadata.get(name)
        if version in earlier:
            return
        if version != wanted:
            raise self._error(
                f"{self.path}: {name.replace('_', ' ')} must be {wanted!r}; got {show(version)}"
            )
        if self.metadata.get("metadata_checksum") != _compute_metadata_checksum(self.metadata):
            raise self._error(f"{self.path}: its metadata are damaged: their checksum does not fit")
        self.type_prefix = ""

    def check_shapes(
        self, wanted: Mapping[str, tuple[int, ...]], *, has_more: bool = False
    ) -> None:
        """Compare names and shapes with those of a configuration, before any array is read.

        Args:
            wanted: Shape by name.
            has_more: Whether the file may hold further arrays.
        """
        missing, unknown = set(wanted) - set(self.found), set(self.found) - set(wanted)
        differing = sorted(missing if has_more else missing | unknown) or sorted(
            name for name, shape in wanted.items() if tuple(shape) != self.found[name][0]
        )
        if differing:
            names = ", ".join(map(tell, differing[:4]))
            raise self._error(f"{self.path}: its tensors do not fit its configuration: {names}")

    def check_types(self, types: Collection[str], *, max_bytes: int) -> None:
        """Refuse arrays of other types, and more bytes than the limit, before any array is read."""
        for name, (shape, dtype) in self.found.items():
            if dtype not in types:
                raise self._error(
                    f"{self.path}: {tell(name)} must be of type {' or '.join(types)}; got {dtype}"
                )
            if any(size < 0 for size in shape):
                raise self._error(f"{self.path}: {tell(name)} has shape {shape}")
        total = sum(math.prod(shape) * _BYTES[dtype] for shape, dtype in self.found.values())
        if total > max_bytes:
            raise self._error(
                f"{self.path}: its arrays must have at most {max_bytes} bytes; got {total}"
            )

    def read(self, *, is_finite: bool = False) -> dict[str, np.ndarray]:
        """Read all arrays, and compare them with their checksum if the file has one.

        Args:
            is_finite: Whether to refuse NaN and infinity.
        """
        arrays = {name: self._file.get_tensor(name) for name in self.found}
        prefix = self.type_prefix
        if prefix is not None and self.metadata.get("checksum") != _compute_checksum(
            arrays, prefix
        ):
            raise self._error(f"{self.path} is damaged: its checksum does not fit its content")
        if is_finite:
            bad = sorted(name for name, array in arrays.items() if not np.isfinite(array).all())
            if bad:
                names = ", ".join(map(tell, bad[:4]))
                raise self._error(f"{self.path}: its tensors must be finite; not so: {names}")
        return arrays


@contextmanager
def open_tensors(path: Path, *, what: str, error: type[Exception]) -> Iterator[TensorFile]:
    """Open a file.

    Args:
        path: The file.
        what: Name of the kind of file for messages, with its article.
        error: Raised if the file is missing or damaged, also while it is read.
    """
    if path.exists() and not path.is_file():  # To open a pipe would wait for ever.
        raise error(f"{path} cannot be read as {what}: it is no file")
    try:
        with safe_open(path, framework="np") as file:
            yield TensorFile(path, file, what, error)
    except (OSError, SafetensorError, MemoryError, OverflowError, TypeError) as err:
        reason = " ".join(str(err).split())[:200] or type(err).__name__
        raise error(f"{path} cannot be read as {what}: {reason}") from err


def _compute_metadata_checksum(metadata: Mapping[str, str]) -> str:
    kept = {name: text for name, text in metadata.items() if name not in _CHECKSUMS}
    return f"{zlib.crc32(json.dumps(kept, sort_keys=True).encode()):08x}"


def _compute_checksum(arrays: Mapping[str, np.ndarray], prefix: str = "") -> str:
    checksum = 0
    for name, array in sorted(arrays.items()):
        head = f"{name} {prefix}{array.dtype} {array.shape}"
        checksum = zlib.crc32(head.encode(), checksum)
        if array.size:
            flat = np.ascontiguousarray(array).reshape(-1)
            checksum = zlib.crc32(flat.view(np.uint8).data, checksum)
    return f"{checksum:08x}"
