"""Read a mesh file of any known kind."""

from __future__ import annotations

import importlib.util
import io
import re
from pathlib import Path
from typing import Any

import numpy as np

from dgl_assets.importing.bounds import check_lines, check_size
from dgl_assets.importing.errors import UnreadableFileError, describe_install
from dgl_assets.importing.guarded import call_reader
from dgl_assets.importing.paths import detect_kind, read_bytes
from dgl_assets.importing.raw import RawMesh, check_raw
from dgl_assets.importing.read_gltf import read_gltf
from dgl_assets.importing.read_obj import read_obj
from dgl_assets.importing.read_usd import read_usd

_VERTEX = re.compile(
    rb"^[ \t]*vertex" + 3 * rb"[ \t]+(\S{1,60})" + rb"[ \t\r]*$", re.MULTILINE | re.IGNORECASE
)  # begins and ends at a line, so that the time is in proportion to the text


def read_mesh(path: Path, *, use_textures: bool = True, root: Path | None = None) -> RawMesh:
    """Read OBJ, PLY, STL, GLB, glTF or USD in a child process.

    The content decides which kind it is; the name must not contradict.

    Args:
        path: Path of the file.
        use_textures: Read materials and pictures. A picture that is missing or outside the folder
            is an error then.
        root: Folder that references must not leave; that of the file by default.

    Returns:
        The mesh as it is in the file: finite, with at least one face, and no index out of range.

    Raises:
        UnreadableFileError: If the file cannot be read whole within the limits.
        UnsafePathError: If it refers to files outside its folder.
    """
    kind = detect_kind(path)
    if kind.startswith("usd") and not _has_pxr():
        raise UnreadableFileError(
            f"{path.name} is USD, which needs the package usd-core: "
            + describe_install("usd", "usd-core")
        )
    options = {
        "use_textures": use_textures,
        "root": None if root is None else str(root.absolute()),
    }
    return call_reader(
        read_here, str(path.absolute()), kind, options, file=path.name, returns=RawMesh
    )


def read_here(file: str, kind: str, options: dict[str, Any]) -> RawMesh:
    """Read a mesh; `read_mesh` calls this in the child process."""
    path, use_textures = Path(file), options["use_textures"]
    root = None if options["root"] is None else Path(options["root"])
    match kind:
        case "obj":
            mesh = read_obj(path, read_bytes(path), use_textures=use_textures, root=root)
        case "ply":
            mesh = read_ply(path)
        case "stl":
            mesh = read_stl(path)
        case "glb" | "gltf":
            mesh = read_gltf(path, use_textures=use_textures, root=root)
        case "usd" | "usdz":
            mesh = read_usd(path, use_textures=use_textures, root=root)
        case _:
            raise UnreadableFileError(f"{path.name} is a {kind} archive inside of another one")
    check_raw(mesh, path.name)
    return mesh


def read_ply(path: Path) -> RawMesh:
    """Read a PLY file, text or binary, that is as long as its header says."""
    from trimesh.exchange.ply import load_ply

    data = read_bytes(path)
    check_lines(data, path.name)
    loaded = load_ply(io.BytesIO(data), fix_texture=False, skip_materials=True)
    counts = {key: item["length"] for key, item in loaded["metadata"]["_ply_raw"].items()}
    vertices = np.asarray(loaded.get("vertices", ()), dtype=np.float64).reshape(-1, 3)
    faces = np.asarray(loaded.get("faces", ()))
    if faces.ndim == 2 and faces.shape[1] == 4:
        faces = np.concatenate([faces[:, [0, 1, 2]], faces[:, [0, 2, 3]]])
    faces = faces.astype(np.int64).reshape(-1, 3)
    if len(vertices) != counts.get("vertex") or len(faces) < counts.get("face", 0):
        raise UnreadableFileError(
            f"{path.name} is cut off: its header promises {counts}, and it holds {len(vertices)} "
            f"vertices and {len(faces)} triangles"
        )
    return RawMesh(vertices=vertices, faces=faces)


def read_stl(path: Path) -> RawMesh:
    """Read an STL file, text or binary, if it is whole. Welding finds its shared vertices."""
    from trimesh.exchange.stl import load_stl_binary

    data = read_bytes(path)
    promised = int.from_bytes(data[80:84], "little") if len(data) >= 84 else -1
    if len(data) == 84 + 50 * promised:
        check_size(3 * promised, promised, path.name)
        vertices = load_stl_binary(io.BytesIO(data))["vertices"]
    elif data[:512].lstrip().lower().startswith(b"solid") and b"\0" not in data:
        vertices = _read_facets(path.name, data)
    else:
        raise UnreadableFileError(
            f"{path.name} is no whole STL file: it has {len(data):,} bytes; as binary it needs "
            f"{84 + 50 * max(promised, 0):,}. It may be cut off"
        )
    vertices = np.asarray(vertices, dtype=np.float64).reshape(-1, 3)
    return RawMesh(vertices=vertices, faces=np.arange(len(vertices)).reshape(-1, 3))


def _read_facets(name: str, data: bytes) -> list[list[float]]:
    """Read the corners of a text STL: as many facets end as begin, each with three corners.

    trimesh reads a text that is cut off, or whose lines end in a carriage return, as less.
    """
    check_lines(data, name)
    if b"\n" not in data:
        data = data.replace(b"\r", b"\n")
    begun, ended, solids = (
        sum(1 for _ in re.finditer(rb"^[ \t]*" + word + rb"\b", data, re.MULTILINE | re.IGNORECASE))
        for word in (b"facet", b"endfacet", b"endsolid")
    )
    vertices = [[float(word) for word in found.groups()] for found in _VERTEX.finditer(data)]
    if begun != ended or len(vertices) != 3 * begun or not solids:
        raise UnreadableFileError(
            f"{name} is cut off or broken: {begun} facets begin, {ended} end, with "
            f"{len(vertices)} whole vertices"
        )
    return vertices


def _has_pxr() -> bool:
    try:
        return importlib.util.find_spec("pxr") is not None
    except ValueError:  # made impossible to import
        return False
