"""Tensors with plain values in one file: policies and states of trainings."""

import json
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from dgl_files import tensors
from dgl_files.fields import decode_json, show
from dgl_files.tensors import TensorFile
from dgl_sadp.errors import CheckpointError

__all__ = ["check_shapes", "open_values", "read_tensors", "write_values"]

_VERSION, _EARLIER = "3", ("1", "2")
_MAX_BYTES = 2**34


def write_values(
    path: Path, state: Mapping[str, Tensor], *, kind: str, values: Mapping[str, Any]
) -> None:
    """Write a file; it appears whole.

    Args:
        path: The file, ending in .safetensors; its folder is made.
        state: Tensors by name.
        kind: Kind of the file, by which it is recognised.
        values: Plain values.

    Raises:
        ValueError: If the path has another ending, or a number among the values is not finite.
    """
    arrays = {name: t.detach().cpu().contiguous().numpy() for name, t in state.items()}
    text = json.dumps(dict(values), allow_nan=False)
    tensors.write_tensors(path, arrays, {"format": kind, "version": _VERSION, "values": text})


@contextmanager
def open_values(path: Path, *, kind: str) -> Iterator[tuple[TensorFile, dict[str, Any]]]:
    """Open a file that `write_values` wrote; gives its tensors, not yet read, and its values.

    Raises:
        CheckpointError: If the file is missing, damaged or of another kind, also while it is read.
    """
    with tensors.open_tensors(path, what=f"a {kind}", error=CheckpointError) as file:
        file.check_format(kind)
        file.check_version(wanted=_VERSION, earlier=_EARLIER)
        text = file.metadata.get("values", "")
        if file.metadata["version"] in _EARLIER:
            file.type_prefix = "torch."
            checksum = f"{zlib.crc32(text.encode()):08x}"
            if file.metadata["version"] == "2" and checksum != file.metadata.get("values_checksum"):
                raise CheckpointError(
                    f"{path}: its metadata are damaged: their checksum does not fit"
                )
        try:
            values = decode_json(text)
        except ValueError as err:
            raise CheckpointError(f"{path}: its metadata are damaged: {err}") from err
        if not isinstance(values, dict):
            raise CheckpointError(f"{path}: its metadata are damaged: {show(values)}")
        yield file, values


def check_shapes(file: TensorFile, wanted: Mapping[str, Tensor], *, has_more: bool = False) -> None:
    """Compare a file with tensors, which may be on the meta device."""
    file.check_shapes({name: tuple(t.shape) for name, t in wanted.items()}, has_more=has_more)
    file.check_types(("F16", "F32"), max_bytes=_MAX_BYTES)


def read_tensors(file: TensorFile) -> dict[str, Tensor]:
    """Read all tensors, which must be finite, in float32 on the CPU."""
    arrays = file.read(is_finite=True)
    return {name: torch.from_numpy(array).float() for name, array in arrays.items()}
