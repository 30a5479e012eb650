"""Read a mesh file of any known kind."""

from __future__ import annotations

from pathlib import Path

from dgl_assets.importing.errors import UnreadableFileError
from dgl_assets.importing.paths import detect_kind, read_bytes
from dgl_assets.importing.raw import RawMesh, check_raw
from dgl_assets.importing.read_gltf import read_gltf
from dgl_assets.importing.read_obj import read_obj
from dgl_assets.importing.read_ply import read_ply
from dgl_assets.importing.read_stl import read_stl
from dgl_assets.importing.read_usd import read_usd


def read_mesh(path: Path, *, use_textures: bool = True, root: Path | None = None) -> RawMesh:
    """Read OBJ, PLY, STL, GLB, glTF or USD. The content says which it is; the name must not contradict.

    Args:
        path: Of the file, at most `bounds.MAX_FILE_BYTES` large.
        use_textures: Whether to read materials and pictures. With them, a picture that is missing or outside the
            folder is an error.
        root: Folder that references must not leave; that of the file by default.

    Returns:
        The mesh as it is in the file: finite, with at least one face, and no index out of range.

    Raises:
        UnreadableFileError: If the file cannot be read whole.
        UnsafePathError: If it refers to files outside its folder.
    """
    data = read_bytes(path)
    kind = detect_kind(path, data)
    match kind:
        case "obj":
            mesh = read_obj(path, data, use_textures=use_textures, root=root)
        case "ply":
            mesh = read_ply(path, data)
        case "stl":
            mesh = read_stl(path, data)
        case "glb" | "gltf":
            mesh = read_gltf(path, data, use_textures=use_textures, root=root)
        case "usd" | "usdz":
            mesh = read_usd(path, use_textures=use_textures, root=root)
        case _:
            raise UnreadableFileError(f"{path.name} is a {kind} archive inside of another one")
    check_raw(mesh, path.name)
    return mesh
