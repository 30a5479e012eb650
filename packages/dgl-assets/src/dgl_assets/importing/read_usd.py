"""USD files, through Pixar's library, which is an extra of this package."""

from __future__ import annotations

import importlib
import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from dgl_assets.importing.errors import (
    AssetImportError,
    UnreadableFileError,
    UnsafePathError,
)
from dgl_assets.importing.paths import TEXTURE_HINT, read_bytes, resolve_reference
from dgl_assets.importing.raw import RawMesh, Texture, check_size
from dgl_assets.importing.textures import load_texture


def read_usd(path: Path, *, use_textures: bool) -> RawMesh:
    """Read the meshes of a USD file (.usd, .usda, .usdc, .usdz) into one.

    Args:
        path: Of the file.
        use_textures: Whether to look for a picture; only those beside the file are read.

    Raises:
        UnreadableFileError: If `usd-core` is not installed, or the file is broken or holds no mesh.
        UnsafePathError: If the file is composed of others: they could be anywhere.

    Limitations:
        Subdivision is not applied; the cage is the mesh.
    """
    pxr = _load_library(path.name)
    try:
        layer = pxr.Sdf.Layer.FindOrOpen(str(path.resolve()))
        if layer is None:
            raise UnreadableFileError(f"{path.name} cannot be read as USD; it may be cut off")
        others = [name for name in layer.GetCompositionAssetDependencies() if name]
        if others:
            raise UnsafePathError(
                f"{path.name} is composed of other files ({', '.join(others)[:100]}); flatten it to one file"
            )
        stage = pxr.Usd.Stage.Open(layer)
        prims = [prim for prim in stage.Traverse() if prim.IsA(pxr.UsdGeom.Mesh)]
        return _collect(path, pxr, stage, prims, use_textures=use_textures)
    except AssetImportError:
        raise
    except Exception as err:  # broken text makes the library raise anything
        raise UnreadableFileError(
            f"{path.name} cannot be read as USD, it may be cut off ({_shorten(err)})"
        ) from err


def _shorten(error: Exception) -> str:
    """What the library says, without where in its own code."""
    text = " ".join(str(error).split())
    quoted = re.findall(r": '(.*?)'$", text)
    return (quoted[-1] if quoted else text)[:160]


def _load_library(name: str) -> Any:
    """Modules of Pixar's library, as attributes; they have no types."""
    try:
        return SimpleNamespace(
            **{
                part: importlib.import_module(f"pxr.{part}")
                for part in ("Sdf", "Usd", "UsdGeom", "UsdShade")
            }
        )
    except ImportError as err:
        raise UnreadableFileError(
            f"{name} is USD, which needs the extra: pip install 'dgl-assets[usd]'"
        ) from err


def _collect(path: Path, pxr: Any, stage: Any, prims: list[Any], *, use_textures: bool) -> RawMesh:
    UsdGeom = pxr.UsdGeom
    vertices, faces, uvs, notes = [], [], [], []
    offset = polygons = 0
    for prim in prims:
        mesh = UsdGeom.Mesh(prim)
        points = np.array(mesh.GetPointsAttr().Get() or [], dtype=np.float64).reshape(-1, 3)
        sizes = np.array(mesh.GetFaceVertexCountsAttr().Get() or [], dtype=np.int64)
        corners = np.array(mesh.GetFaceVertexIndicesAttr().Get() or [], dtype=np.int64)
        name = str(prim.GetPath())
        if not len(sizes):
            continue
        check_size(len(points), len(corners), path.name)
        if sizes.min() < 3 or sizes.sum() != len(corners):
            raise UnreadableFileError(
                f"{path.name}: {name} has {len(sizes)} faces with {sizes.sum()} corners, but {len(corners)} indices"
            )
        if corners.min() < 0 or corners.max() >= len(points):
            raise UnreadableFileError(
                f"{path.name}: {name} uses vertices {corners.min()} to {corners.max()} of {len(points)}"
            )
        triangles = _fan(sizes)
        if mesh.GetOrientationAttr().Get() == UsdGeom.Tokens.leftHanded:
            triangles = triangles[:, ::-1]
        matrix = np.array(UsdGeom.Xformable(prim).ComputeLocalToWorldTransform(0.0))
        vertices.append(points @ matrix[:3, :3] + matrix[3, :3])  # USD multiplies rows
        faces.append(corners[triangles] + offset)
        uvs.append(_read_uvs(UsdGeom, prim, corners, triangles))
        offset += len(points)
        polygons += int((sizes > 3).sum())
    if not faces:
        raise UnreadableFileError(f"{path.name} holds no mesh")
    if polygons:
        notes.append(f"{polygons} polygons of more than three corners were cut into triangles")
    texture = None
    has_uvs = all(uv is not None for uv in uvs)
    if use_textures and has_uvs:
        texture, more = _read_texture(path, pxr, stage)
        notes += more
    return RawMesh(
        vertices=np.concatenate(vertices),
        faces=np.concatenate(faces),
        uvs=np.concatenate([uv for uv in uvs if uv is not None]) if has_uvs else None,
        texture=texture,
        unit=float(UsdGeom.GetStageMetersPerUnit(stage))
        if UsdGeom.StageHasAuthoredMetersPerUnit(stage)
        else None,
        up=str(UsdGeom.GetStageUpAxis(stage)).lower(),
        notes=tuple(notes),
    )


def _fan(sizes: np.ndarray) -> np.ndarray:
    """Index of the corner of each triangle in the list of corners, shape (F, 3)."""
    start = np.cumsum(sizes) - sizes
    count = sizes - 2
    owner = np.repeat(np.arange(len(sizes)), count)
    ordinal = np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count)
    first = start[owner]
    return np.column_stack([first, first + ordinal + 1, first + ordinal + 2])


def _read_uvs(
    UsdGeom: Any, prim: Any, corners: np.ndarray, triangles: np.ndarray
) -> np.ndarray | None:
    for name in ("st", "UVMap", "map1", "uv"):
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


def _read_texture(path: Path, pxr: Any, stage: Any) -> tuple[Texture | None, list[str]]:
    """A picture that a shader refers to, if it lies beside the file."""
    for prim in stage.Traverse():
        if not prim.IsA(pxr.UsdShade.Shader):
            continue
        for attribute in prim.GetAttributes():
            value = attribute.Get()
            if not isinstance(value, pxr.Sdf.AssetPath):
                continue
            if not value.path.lower().endswith((".png", ".jpg", ".jpeg")):
                continue
            target = resolve_reference(
                path.parent, value.path, named_by=path.name, hint=TEXTURE_HINT
            )
            return load_texture(read_bytes(target), target.name), []
    return None, ["no picture beside the file; materials of other libraries are not read"]
