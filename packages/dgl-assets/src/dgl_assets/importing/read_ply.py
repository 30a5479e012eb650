"""PLY, text and binary. The header is checked against the size of the file before trimesh decodes it."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
from trimesh.exchange.ply import load_ply

from dgl_assets.importing.bounds import check_lines, check_size
from dgl_assets.importing.errors import UnreadableFileError
from dgl_assets.importing.raw import RawMesh

_SIZES = {
    "char": 1, "uchar": 1, "int8": 1, "uint8": 1, "short": 2, "ushort": 2, "int16": 2, "uint16": 2,
    "int": 4, "uint": 4, "int32": 4, "uint32": 4, "float": 4, "float32": 4, "double": 8, "float64": 8,
}  # fmt: skip
_MAX_HEADER = 65536


def read_ply(path: Path, data: bytes) -> RawMesh:
    """Read a PLY file.

    Raises:
        UnreadableFileError: If the header is broken or the body is not as long as it says.
    """
    counts = check_header(path.name, data)
    try:
        loaded = load_ply(io.BytesIO(data), fix_texture=False, skip_materials=True)
        vertices = np.asarray(loaded["vertices"], dtype=np.float64)
        faces = np.asarray(loaded["faces"])
        if faces.ndim == 2 and faces.shape[1] == 4:
            faces = np.concatenate([faces[:, [0, 1, 2]], faces[:, [0, 2, 3]]])
        faces = faces.astype(np.int64).reshape(-1, 3)
    except Exception as err:  # the decoder raises anything on broken bodies
        raise UnreadableFileError(
            f"{path.name} cannot be decoded as PLY, it may be cut off ({type(err).__name__}: {str(err)[:100]})"
        ) from err
    if vertices.shape != (counts["vertex"], 3):
        raise UnreadableFileError(
            f"{path.name} promises {counts['vertex']} vertices and holds an array of shape {vertices.shape}"
        )
    if len(faces) < counts["face"]:
        raise UnreadableFileError(
            f"{path.name} promises {counts['face']} faces and holds {len(faces)}; it may be cut off"
        )
    return RawMesh(vertices=vertices, faces=faces)


def check_header(name: str, data: bytes) -> dict[str, int]:
    """Check the header and that the body can hold what it promises.

    Args:
        name: Of the file, for messages.
        data: The file.

    Returns:
        Number of items of each element.

    Raises:
        UnreadableFileError: If the header is broken, or the body too short or too large.
    """
    end = data.find(b"end_header", 0, _MAX_HEADER)
    newline = data.find(b"\n", end) if end >= 0 else -1
    if newline < 0:
        raise UnreadableFileError(f"{name}: the header of the PLY does not end; it may be cut off")
    form, counts, sizes = "", {}, {}
    element = ""
    try:
        for line in data[:end].decode("latin-1").splitlines()[1:]:
            words = line.split()
            if words and words[0] == "format":
                form = words[1]
            elif words and words[0] == "element":
                element = words[1]
                counts[element], sizes[element] = int(words[2]), 0
            elif words and words[0] == "property":
                # A list has at least its count.
                sizes[element] += _SIZES[words[2] if words[1] == "list" else words[1]]
    except (IndexError, KeyError, ValueError) as err:
        raise UnreadableFileError(
            f"{name}: the header of the PLY is broken ({type(err).__name__}: {str(err)[:80]})"
        ) from err
    if form not in ("ascii", "binary_little_endian", "binary_big_endian"):
        raise UnreadableFileError(f"{name}: unknown PLY format {form[:40]!r}")
    if min(counts.get("vertex", 0), counts.get("face", 0)) <= 0 or min(counts.values()) < 0:
        raise UnreadableFileError(
            f"{name} holds no surface: its header promises "
            + ", ".join(f"{count} {kind}" for kind, count in counts.items())
        )
    check_size(counts["vertex"], counts["face"], name)
    body = data[newline + 1 :]
    if form == "ascii":
        check_lines(body, name)
        found, needed, what = _count_lines(body), sum(counts.values()), "lines"
    else:
        found, needed, what = len(body), sum(counts[k] * sizes[k] for k in counts), "bytes"
    if found < needed:
        raise UnreadableFileError(
            f"{name} is cut off: its header promises at least {needed:,} {what}, {found:,} are there"
        )
    return counts


def _count_lines(body: bytes) -> int:
    """Lines that hold something."""
    lines = io.TextIOWrapper(io.BytesIO(body), encoding="latin-1")
    return sum(1 for line in lines if not line.isspace())
