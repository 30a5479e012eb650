"""Tensors with JSON in one safetensors file: written beside its place and renamed, with checksums of both."""

import json
import os
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import Tensor

from dgl_files.fields import decode_json, show, tell
from dgl_sadp.errors import CheckpointError

__all__ = ["TensorFile", "open_tensors", "read_header", "write_tensors"]

VERSION = "2"
_UNCHECKED_VERSION = "1"  # Of files whose plain values have no checksum.
_DTYPES = {torch.float32: "F32", torch.float16: "F16", torch.bfloat16: "BF16"}


def write_tensors(
    path: Path, tensors: Mapping[str, Tensor], *, kind: str, values: Mapping[str, Any]
) -> None:
    """Write a file; one that exists is replaced only by a whole one.

    Args:
        path: The file, ending in .safetensors; its folder is made.
        tensors: What to write.
        kind: What the file is, by which it is recognised.
        values: Plain values to go along.

    Raises:
        ValueError: If the path has another ending, or a number among the values is not finite.
    """
    if path.suffix != ".safetensors":
        raise ValueError(f"path must end in .safetensors; got {path}")
    whole = {name: t.detach().cpu().contiguous() for name, t in tensors.items()}
    text = json.dumps(dict(values), allow_nan=False)
    metadata = {
        "format": kind,
        "version": VERSION,
        "checksum": f"{_compute_checksum(whole):08x}",
        "values": text,
        "values_checksum": f"{zlib.crc32(text.encode()):08x}",
    }
    path.parent.mkdir(parents=True, exist_ok=True)
    beside = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        save_file(whole, beside, metadata=metadata)
        with beside.open("rb") as file:
            os.fsync(file.fileno())
        beside.chmod(0o644)  # safetensors lets only the owner read.
        beside.replace(path)
    finally:
        beside.unlink(missing_ok=True)


class TensorFile:
    """An open file: what it says about itself; its tensors are read when asked for."""

    def __init__(self, path: Path, file: Any, kind: str) -> None:
        """Read and check the header; see `open_tensors`."""
        self.path = path
        self._file = file
        metadata = file.metadata() or {}
        if metadata.get("format") != kind:
            raise CheckpointError(
                f"{path} is no {kind}: its format must be {kind!r}; "
                f"got {show(metadata.get('format'))}"
            )
        version = metadata.get("version")
        if version not in (VERSION, _UNCHECKED_VERSION):
            raise CheckpointError(f"{path}: version must be {VERSION!r}; got {show(version)}")
        text = metadata.get("values")
        if text is None:
            raise CheckpointError(f"{path}: its metadata are damaged: there are no values")
        if (
            version == VERSION
            and metadata.get("values_checksum") != f"{zlib.crc32(text.encode()):08x}"
        ):
            raise CheckpointError(f"{path}: its metadata are damaged: their checksum does not fit")
        try:
            values = decode_json(text)
        except ValueError as err:
            raise CheckpointError(f"{path}: its metadata are damaged: {err}") from err
        if not isinstance(values, dict):
            raise CheckpointError(f"{path}: its metadata are damaged: {show(values)}")
        self.values: dict[str, Any] = values
        """The plain values."""
        self._checksum = metadata.get("checksum")
        slices = {name: file.get_slice(name) for name in file.keys()}  # noqa: SIM118
        self.shapes: dict[str, tuple[int, ...]] = {
            name: tuple(each.get_shape()) for name, each in slices.items()
        }
        """Shape of each tensor."""
        self._dtypes = {name: each.get_dtype() for name, each in slices.items()}

    def check(self, wanted: Mapping[str, Tensor], *, allow_more: bool = False) -> None:
        """Compare names, shapes and types with those of tensors, such as some on the meta device.

        Raises:
            CheckpointError: If something differs.
        """
        missing, unknown = set(wanted) - set(self.shapes), set(self.shapes) - set(wanted)
        differing = sorted(missing if allow_more else missing | unknown) or sorted(
            name for name in wanted if tuple(wanted[name].shape) != self.shapes[name]
        )
        if differing:
            raise CheckpointError(
                f"{self.path}: its tensors do not fit its configuration: {', '.join(map(tell, differing[:4]))}"
            )
        for name, tensor in wanted.items():
            if self._dtypes[name] != _DTYPES.get(tensor.dtype):
                raise CheckpointError(
                    f"{self.path}: {name} must be of type {_DTYPES.get(tensor.dtype)}; "
                    f"got {self._dtypes[name]}"
                )

    def read(self) -> dict[str, Tensor]:
        """Read all tensors, on the CPU. They are mapped: they must be copied before the file is closed.

        Raises:
            CheckpointError: If a checksum does not fit, or a value is not finite.
        """
        tensors = {name: self._file.get_tensor(name) for name in self.shapes}
        if self._checksum != f"{_compute_checksum(tensors):08x}":
            raise CheckpointError(f"{self.path} is damaged: its checksum does not fit its content")
        bad = sorted(
            name
            for name, tensor in tensors.items()
            if tensor.is_floating_point() and not torch.isfinite(tensor).all()
        )
        if bad:
            raise CheckpointError(
                f"{self.path}: its tensors must be finite; not so: {', '.join(map(tell, bad[:4]))}"
            )
        return tensors


@contextmanager
def open_tensors(path: Path, *, kind: str) -> Iterator[TensorFile]:
    """Open a file that `write_tensors` wrote.

    Raises:
        CheckpointError: If the file is missing, damaged or of another kind, also while it is read.
    """
    if path.exists() and not path.is_file():  # To open a pipe would wait for ever.
        raise CheckpointError(f"{path} cannot be read as a {kind}: it is no file")
    try:
        with safe_open(path, framework="pt") as file:
            yield TensorFile(path, file, kind)
    # safetensors leaves it to torch to refuse sizes that no memory holds.
    except (OSError, SafetensorError, RuntimeError, MemoryError, OverflowError) as err:
        reason = " ".join(str(err).split())[:200] or type(err).__name__
        raise CheckpointError(f"{path} cannot be read as a {kind}: {reason}") from err


def read_header(path: Path, *, kind: str) -> dict[str, Any]:
    """Read the plain values alone; raises as `open_tensors` does."""
    with open_tensors(path, kind=kind) as file:
        return file.values


def _compute_checksum(tensors: Mapping[str, Tensor]) -> int:
    checksum = 0
    for name in sorted(tensors):
        tensor = tensors[name]
        checksum = zlib.crc32(f"{name} {tensor.dtype} {tuple(tensor.shape)}".encode(), checksum)
        if tensor.numel():
            flat = tensor.reshape(-1).view(torch.uint8).numpy()
            checksum = zlib.crc32(flat.data, checksum)
    return checksum
