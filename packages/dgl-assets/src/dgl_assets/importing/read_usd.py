"""USD files, through Pixar's library, which is an extra of this package.

It ends its process on some damaged files; they are read in a child.
"""

from __future__ import annotations

import importlib
import re
from pathlib import Path
from typing import Any

import numpy as np

from dgl_assets.importing.bounds import check_size
from dgl_assets.importing.errors import AssetImportError, UnreadableFileError, UnsafePathError
from dgl_assets.importing.paths import TEXTURE_HINT, read_bytes, resolve_reference
from dgl_assets.importing.raw import RawMesh, triangulate
from dgl_assets.importing.textures import load_texture

_PICTURES = (".png", ".jpg", ".jpeg")
_UV_NAMES = ("st", "UVMap", "map1", "uv")


def read_usd(path: Path, *, use_textures: bool, root: Path | None = None) -> RawMesh:
    """Read the meshes of a USD file (.usd, .usda, .usdc, .usdz) into one.

    Args:
        path: Path of the file.
        use_textures: Look for a picture; only those beside the file are read.
        root: Folder that references must not leave; that of the file by default.

    Raises:
        UnreadableFileError: If the file is broken or holds no mesh.
        UnsafePathError: If the file is composed of others: they could be anywhere.

    Limitations:
        Subdivision is not applied; the cage is the mesh. Pictures within a .usdz are not read.
    """
    try:
        return _read(path, use_textures=use_textures, root=root)
    except AssetImportError:
        raise
    except Exception as err:  # the library has errors of its own
        said = re.findall(r" in file \S+ : '(.{3,120})", str(err))
        raise UnreadableFileError(
            f"{path.name} cannot be read as USD, it may be cut off "
            f"({said[-1] if said else type(err).__name__})"
        ) from err


def _read(path: Path, *, use_textures: bool, root: Path | None) -> RawMesh:
    Sdf, Usd, UsdGeom = _load("Sdf"), _load("Usd"), _load("UsdGeom")

    layer = Sdf.Layer.FindOrOpen(str(path))
    if layer is None:
        raise UnreadableFileError(f"{path.name} cannot be read as USD, it may be cut off")
    parts = [name for name in layer.GetCompositionAssetDependencies() if name]
    if parts:
        raise UnsafePathError(
            f"{path.name} is composed of other files ({', '.join(parts)[:100]}); flatten it"
        )
    stage = Usd.Stage.Open(layer)
    vertices, faces, uvs = [], [], []
    names, owners = [], []
    offset = polygons = count = 0
    for prim in stage.Traverse():
        if not prim.IsA(UsdGeom.Mesh):
            continue
        mesh, name = UsdGeom.Mesh(prim), str(prim.GetPath())
        points = np.array(mesh.GetPointsAttr().Get() or [], dtype=np.float64).reshape(-1, 3)
        sizes = np.array(mesh.GetFaceVertexCountsAttr().Get() or [], dtype=np.int64)
        corners = np.array(mesh.GetFaceVertexIndicesAttr().Get() or [], dtype=np.int64)
        if not len(sizes):
            continue
        if sizes.min() < 3 or sizes.sum() != len(corners):
            raise UnreadableFileError(
                f"{path.name} cannot be read as USD: {name} has {len(sizes)} faces with "
                f"{sizes.sum()} corners, but {len(corners)} indices"
            )
        if corners.min() < 0 or corners.max() >= len(points):
            raise UnreadableFileError(
                f"{path.name} cannot be read as USD: {name} uses vertices {corners.min()} to "
                f"{corners.max()} of {len(points)}"
            )
        owner, choice = triangulate(sizes)
        triangles = (np.cumsum(sizes) - sizes)[owner][:, None] + choice
        if mesh.GetOrientationAttr().Get() == UsdGeom.Tokens.leftHanded:
            triangles = triangles[:, ::-1]
        check_size(offset + len(points), count + len(triangles), path.name)
        matrix = np.array(UsdGeom.Xformable(prim).ComputeLocalToWorldTransform(0.0))
        with np.errstate(invalid="ignore", over="ignore"):  # judged with all vertices
            vertices.append(points @ matrix[:3, :3] + matrix[3, :3])  # USD multiplies rows
        faces.append(corners[triangles] + offset)
        owners.append(np.full(len(triangles), len(names)))
        names.append((prim.GetName(), name))
        uvs.append(_read_uvs(prim, corners, triangles))
        offset, count = offset + len(points), count + len(triangles)
        polygons += int((sizes > 3).sum())
    if not faces:
        raise UnreadableFileError(f"{path.name} cannot be read as USD: it holds no mesh")
    notes, texture = [], None
    if polygons:
        notes.append(f"{polygons} polygons of more than three corners were cut into triangles")
    has_uvs = all(uv is not None for uv in uvs)
    if use_textures and has_uvs:
        picture = _find_picture(stage)
        if picture is None:
            notes.append("no picture; materials of other libraries are not read")
        else:
            target = resolve_reference(
                path.parent, picture, named_by=path.name, root=root, hint=TEXTURE_HINT
            )
            texture = load_texture(read_bytes(target), target.name)
    has_unit = UsdGeom.StageHasAuthoredMetersPerUnit(stage)
    return RawMesh(
        vertices=np.concatenate(vertices),
        faces=np.concatenate(faces),
        uvs=np.concatenate([uv for uv in uvs if uv is not None]) if has_uvs else None,
        texture=texture,
        unit=float(UsdGeom.GetStageMetersPerUnit(stage)) if has_unit else None,
        up=str(UsdGeom.GetStageUpAxis(stage)).lower(),
        notes=tuple(notes),
        objects=tuple(names),
        object_ids=np.concatenate(owners),
    )


def _load(part: str) -> Any:
    """Import a module of Pixar's library; they have no types."""
    return importlib.import_module(f"pxr.{part}")


def _read_uvs(prim: Any, corners: np.ndarray, triangles: np.ndarray) -> np.ndarray | None:
    UsdGeom = _load("UsdGeom")

    for name in _UV_NAMES:
        primvar = UsdGeom.PrimvarsAPI(prim).GetPrimvar(name)
        if not primvar or not primvar.HasValue():
            continue
        values = np.array(primvar.ComputeFlattened(), dtype=np.float64)
        if values.ndim != 2 or values.shape[1] != 2:
            continue
        if primvar.GetInterpolation() == UsdGeom.Tokens.faceVarying and len(values) == len(corners):
            return values[triangles]
        if len(values) > corners.max():
            return values[corners[triangles]]
    return None


def _find_picture(stage: Any) -> str | None:
    """Find the first picture that a shader refers to."""
    Sdf, UsdShade = _load("Sdf"), _load("UsdShade")

    for prim in stage.Traverse():
        if not prim.IsA(UsdShade.Shader):
            continue
        for attribute in prim.GetAttributes():
            value = attribute.Get()
            if isinstance(value, Sdf.AssetPath) and value.path.lower().endswith(_PICTURES):
                return str(value.path)
    return None
