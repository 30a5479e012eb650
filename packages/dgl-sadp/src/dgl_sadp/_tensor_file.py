"""Tensors with JSON in one safetensors file: written beside its place and renamed, with a checksum."""

import json
import os
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import Tensor

from dgl_sadp.errors import CheckpointError

__all__ = ["read_header", "read_tensors", "write_tensors"]

VERSION = "1"


def write_tensors(
    path: Path, tensors: Mapping[str, Tensor], *, kind: str, values: Mapping[str, Any]
) -> None:
    """Write a file; one that exists is replaced only by a whole one.

    Args:
        path: The file, ending in .safetensors; its folder is made.
        tensors: What to write.
        kind: What the file is, by which it is recognised.
        values: Plain values to go along.
    """
    if path.suffix != ".safetensors":
        raise ValueError(f"path must end in .safetensors; got {path}")
    whole = {name: t.detach().cpu().contiguous() for name, t in tensors.items()}
    metadata = {
        "format": kind,
        "version": VERSION,
        "checksum": f"{_compute_checksum(whole):08x}",
        "values": json.dumps(dict(values)),
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


def read_tensors(path: Path, *, kind: str) -> tuple[dict[str, Tensor], dict[str, Any]]:
    """Read a file that `write_tensors` wrote.

    Returns:
        The tensors, on the CPU, and the plain values.

    Raises:
        CheckpointError: If the file is missing, damaged or of another kind.
    """
    values, metadata = _read_header(path, kind=kind)
    try:
        with safe_open(path, framework="pt") as file:
            # Cloned: the file is mapped, and may be replaced while these are in use.
            tensors = {name: file.get_tensor(name).clone() for name in file.keys()}  # noqa: SIM118
    except (OSError, SafetensorError) as err:
        raise CheckpointError(f"{path} cannot be read: {err}") from err
    if metadata.get("checksum") != f"{_compute_checksum(tensors):08x}":
        raise CheckpointError(f"{path} is damaged: its checksum does not fit its content")
    return tensors, values


def read_header(path: Path, *, kind: str) -> dict[str, Any]:
    """Read the plain values alone; raises as `read_tensors` does."""
    return _read_header(path, kind=kind)[0]


def _read_header(path: Path, *, kind: str) -> tuple[dict[str, Any], dict[str, str]]:
    try:
        with safe_open(path, framework="pt") as file:
            metadata = file.metadata() or {}
    except (OSError, SafetensorError) as err:
        raise CheckpointError(f"{path} cannot be read as a {kind}: {err}") from err
    if metadata.get("format") != kind:
        raise CheckpointError(
            f"{path} is no {kind}: its format must be {kind!r}; got {metadata.get('format')!r}"
        )
    if metadata.get("version") != VERSION:
        raise CheckpointError(
            f"{path}: version must be {VERSION!r}; got {metadata.get('version')!r}"
        )
    try:
        values = json.loads(metadata["values"])
    except (KeyError, ValueError) as err:
        raise CheckpointError(f"{path}: its metadata are damaged: {err}") from err
    if not isinstance(values, dict):
        raise CheckpointError(f"{path}: its metadata are damaged: {str(values)[:60]}")
    return values, metadata


def _compute_checksum(tensors: Mapping[str, Tensor]) -> int:
    checksum = 0
    for name in sorted(tensors):
        tensor = tensors[name]
        checksum = zlib.crc32(f"{name} {tensor.dtype} {tuple(tensor.shape)}".encode(), checksum)
        if tensor.numel():
            flat = tensor.reshape(-1).view(torch.uint8).numpy()
            checksum = zlib.crc32(flat.data, checksum)
    return checksum
