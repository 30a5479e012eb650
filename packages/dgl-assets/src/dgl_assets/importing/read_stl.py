"""STL, text and binary. It has neither units nor shared vertices; welding finds them again."""

from __future__ import annotations

import io
import re
from pathlib import Path

import numpy as np
from trimesh.exchange.stl import load_stl

from dgl_assets.importing.errors import UnreadableFileError
from dgl_assets.importing.raw import RawMesh, check_size


def read_stl(path: Path, data: bytes) -> RawMesh:
    """Read an STL file.

    Raises:
        UnreadableFileError: If it is cut off.
    """
    promised = int.from_bytes(data[80:84], "little") if len(data) >= 84 else -1
    if promised < 0 or len(data) != 84 + 50 * promised:
        promised = _count_text(path.name, data, promised)
    check_size(3 * promised // 3, promised, path.name)
    try:
        loaded = load_stl(io.BytesIO(data))
        vertices = np.asarray(loaded["vertices"], dtype=np.float64).reshape(-1, 3)
        faces = np.asarray(loaded["faces"], dtype=np.int64).reshape(-1, 3)
    except Exception as err:  # the decoder raises anything on broken text
        raise UnreadableFileError(
            f"{path.name} cannot be decoded as STL ({type(err).__name__}: {str(err)[:100]})"
        ) from err
    if len(faces) != promised:
        raise UnreadableFileError(
            f"{path.name} promises {promised} triangles and holds {len(faces)}; it may be cut off"
        )
    return RawMesh(vertices=vertices, faces=faces)


def _count_text(name: str, data: bytes, promised: int) -> int:
    """Triangles of a text file, if it is whole."""
    head = data[:512].lstrip().lower()
    if not head.startswith(b"solid") or b"\0" in data:
        needed = f"; as binary it needs {84 + 50 * promised:,} bytes" if promised >= 0 else ""
        raise UnreadableFileError(
            f"{name} is no whole STL file: it has {len(data):,} bytes{needed}. It may be cut off"
        )
    facets = len(re.findall(rb"^\s*facet\b", data, re.M | re.I))
    ends = len(re.findall(rb"^\s*endfacet\b", data, re.M | re.I))
    corners = len(re.findall(rb"^\s*vertex\s+\S+\s+\S+\s+\S+\s*$", data, re.M | re.I))
    if (
        facets != ends
        or corners != 3 * facets
        or not re.search(rb"^\s*endsolid", data, re.M | re.I)
    ):
        raise UnreadableFileError(
            f"{name} is cut off or broken: {facets} facets begin, {ends} end, with {corners} whole vertices"
        )
    return facets
