"""STL, text and binary. It has neither units nor shared vertices; welding finds them again."""

from __future__ import annotations

import io
import re
from pathlib import Path

import numpy as np
from trimesh.exchange.stl import load_stl_binary

from dgl_assets.importing.bounds import check_lines, check_size
from dgl_assets.importing.errors import UnreadableFileError
from dgl_assets.importing.raw import RawMesh

# Patterns begin at a line and end with it, so that the time is in proportion to the text.
_NUMBER = rb"[ \t]+(\S{1,60})"
_VERTEX = re.compile(rb"^[ \t]*vertex" + 3 * _NUMBER + rb"[ \t\r]*$", re.MULTILINE | re.IGNORECASE)


def read_stl(path: Path, data: bytes) -> RawMesh:
    """Read an STL file.

    Raises:
        UnreadableFileError: If it is cut off.
    """
    promised = int.from_bytes(data[80:84], "little") if len(data) >= 84 else -1
    if promised < 0 or len(data) != 84 + 50 * promised:
        return _read_text(path.name, data, promised)
    check_size(3 * promised, promised, path.name)
    try:
        loaded = load_stl_binary(io.BytesIO(data))
        vertices = np.asarray(loaded["vertices"], dtype=np.float64).reshape(-1, 3)
        faces = np.asarray(loaded["faces"], dtype=np.int64).reshape(-1, 3)
    except Exception as err:  # the decoder raises anything on broken files
        raise UnreadableFileError(
            f"{path.name} cannot be decoded as STL ({type(err).__name__}: {str(err)[:100]})"
        ) from err
    return RawMesh(vertices=vertices, faces=faces)


def _read_text(name: str, data: bytes, promised: int) -> RawMesh:
    """Read a text file if it is whole: as many facets end as begin, each with three corners."""
    if not data[:512].lstrip().lower().startswith(b"solid") or b"\0" in data:
        needed = f"; as binary it needs {84 + 50 * promised:,} bytes" if promised >= 0 else ""
        raise UnreadableFileError(
            f"{name} is no whole STL file: it has {len(data):,} bytes{needed}. It may be cut off"
        )
    check_lines(data, name)
    if b"\n" not in data:
        data = data.replace(b"\r", b"\n")
    begun, ended, solids = (
        sum(1 for _ in re.finditer(rb"^[ \t]*" + word + rb"\b", data, re.MULTILINE | re.IGNORECASE))
        for word in (b"facet", b"endfacet", b"endsolid")
    )
    check_size(3 * begun, begun, name)
    count = sum(1 for _ in _VERTEX.finditer(data))
    if begun != ended or count != 3 * begun or not solids:
        raise UnreadableFileError(
            f"{name} is cut off or broken: {begun} facets begin, {ended} end, with {count} whole vertices"
        )
    try:
        vertices = np.array(
            [[float(word) for word in found.groups()] for found in _VERTEX.finditer(data)],
            dtype=np.float64,
        )
    except ValueError as err:
        raise UnreadableFileError(
            f"{name}: a vertex is not three numbers ({str(err)[:80]})"
        ) from err
    return RawMesh(vertices=vertices.reshape(-1, 3), faces=np.arange(3 * begun).reshape(-1, 3))
