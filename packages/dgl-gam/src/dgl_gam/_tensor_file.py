"""Safetensors files with checksums of their arrays and of their metadata."""

import json
import math
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from safetensors import SafetensorError, safe_open

from dgl_files.fields import show, tell

__all__ = ["ArrayFile", "open_arrays", "seal"]

SEALED, UNSEALED = "2", "1"
"""Versions of files with checksums, and of those from before there were any."""
_CHECKSUMS = ("checksum", "metadata_checksum")
_BYTES = {"F16": 2, "F32": 4, "I32": 4}


def seal(metadata: Mapping[str, str], arrays: Mapping[str, np.ndarray]) -> dict[str, str]:
    """Return the metadata with the checksums of both."""
    return {
        **metadata,
        "checksum": _compute_checksum(arrays),
        "metadata_checksum": _compute_metadata_checksum(metadata),
    }


class ArrayFile:
    """An open file: what it says about itself; its arrays are read when asked for."""

    def __init__(self, path: Path, file: Any, what: str, error: type[Exception]) -> None:
        """Take over an open file; see `open_arrays`."""
        self.path = path
        self.metadata: dict[str, str] = dict(file.metadata() or {})
        """What is written beside the arrays."""
        slices = {name: file.get_slice(name) for name in file.keys()}  # noqa: SIM118
        self.found: dict[str, tuple[tuple[int, ...], str]] = {
            name: (tuple(each.get_shape()), each.get_dtype()) for name, each in slices.items()
        }
        """Shape and type of each array, as safetensors names types."""
        self._file, self._what, self._error = file, what, error
        self._is_sealed = False

    def check_version(self, name: str) -> None:
        """Check the version, which is called `name`, and the checksum of the metadata, where it has one."""
        version = self.metadata.get(name)
        if version not in (SEALED, UNSEALED):
            raise self._error(
                f"{self.path}: {name.replace('_', ' ')} must be {SEALED!r}; got {show(version)}"
            )
        self._is_sealed = version == SEALED
        if not self._is_sealed:
            return
        if self.metadata.get("metadata_checksum") != _compute_metadata_checksum(self.metadata):
            raise self._error(f"{self.path}: its metadata are damaged: their checksum does not fit")

    def check_types(self, types: tuple[str, ...], *, max_bytes: int) -> None:
        """Refuse arrays of other types, and more of them than fit into memory, before any is read."""
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

    def read(self) -> dict[str, np.ndarray]:
        """Read all arrays, and compare them with their checksum, where the file has one."""
        arrays = {name: self._file.get_tensor(name) for name in self.found}
        if self._is_sealed and self.metadata.get("checksum") != _compute_checksum(arrays):
            raise self._error(f"{self.path} is damaged: its checksum does not fit its content")
        return arrays


@contextmanager
def open_arrays(path: Path, *, what: str, error: type[Exception]) -> Iterator[ArrayFile]:
    """Open a file.

    Args:
        path: The file.
        what: What it should be, for messages.
        error: What is raised if it is missing or damaged, also while it is read.
    """
    if path.exists() and not path.is_file():  # To open a pipe would wait for ever.
        raise error(f"{path} cannot be read as {what}: it is no file")
    try:
        with safe_open(path, framework="np") as file:
            yield ArrayFile(path, file, what, error)
    except (OSError, SafetensorError, MemoryError, OverflowError, TypeError) as err:
        reason = " ".join(str(err).split())[:200] or type(err).__name__
        raise error(f"{path} cannot be read as {what}: {reason}") from err


def _compute_metadata_checksum(metadata: Mapping[str, str]) -> str:
    kept = {name: text for name, text in metadata.items() if name not in _CHECKSUMS}
    return f"{zlib.crc32(json.dumps(kept, sort_keys=True).encode()):08x}"


def _compute_checksum(arrays: Mapping[str, np.ndarray]) -> str:
    checksum = 0
    for name in sorted(arrays):
        array = np.ascontiguousarray(arrays[name])
        checksum = zlib.crc32(f"{name} {array.dtype} {arrays[name].shape}".encode(), checksum)
        if array.size:
            checksum = zlib.crc32(array.reshape(-1).view(np.uint8).data, checksum)
    return f"{checksum:08x}"
