"""Reads USD in a process of its own, since Pixar's library ends the process on some damaged files.

Needs numpy and that library alone. What it finds goes into one NPZ file: `facts` is JSON, the rest are arrays.
"""

from __future__ import annotations

import importlib
import json
from pathlib import Path
from typing import Any

import numpy as np

_PICTURES = (".png", ".jpg", ".jpeg")
_UV_NAMES = ("st", "UVMap", "map1", "uv")


def read_to_file(source: str, target: str, most_vertices: str, most_corners: str) -> None:
    """Read the meshes of a USD file into one.

    Args:
        source: USD file.
        target: NPZ file to write.
        most_vertices: Largest number of vertices.
        most_corners: Largest number of corners of faces.

    `facts` holds `problem` (a text, or null), `parts` (other files that it is composed of), `unit` [m] or null, `up`,
    `polygons` (faces of more than three corners), `objects` (names of each mesh) and `picture` (reference, or null).
    """
    facts, arrays = _read(Path(source), int(most_vertices), int(most_corners))
    with Path(target).open("wb") as file:
        np.savez(file, allow_pickle=False, facts=np.array(json.dumps(facts)), **arrays)


def _read(
    path: Path, most_vertices: int, most_corners: int
) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    Sdf, Usd, UsdGeom = _load("Sdf"), _load("Usd"), _load("UsdGeom")

    facts: dict[str, Any] = {"problem": None, "parts": []}
    layer = Sdf.Layer.FindOrOpen(str(path))
    if layer is None:
        return {**facts, "problem": "it may be cut off"}, {}
    facts["parts"] = [name for name in layer.GetCompositionAssetDependencies() if name]
    if facts["parts"]:
        return facts, {}
    stage = Usd.Stage.Open(layer)
    vertices, faces, uvs = [], [], []
    names, owners = [], []
    offset = polygons = total = 0
    for prim in stage.Traverse():
        if not prim.IsA(UsdGeom.Mesh):
            continue
        mesh, name = UsdGeom.Mesh(prim), str(prim.GetPath())
        points = np.array(mesh.GetPointsAttr().Get() or [], dtype=np.float64).reshape(-1, 3)
        sizes = np.array(mesh.GetFaceVertexCountsAttr().Get() or [], dtype=np.int64)
        corners = np.array(mesh.GetFaceVertexIndicesAttr().Get() or [], dtype=np.int64)
        if not len(sizes):
            continue
        total += len(corners)
        if offset + len(points) > most_vertices or total > most_corners:
            problem = (
                f"up to {name} it has {offset + len(points):,} vertices and {total:,} corners, at most "
                f"{most_vertices:,} and {most_corners:,} are read"
            )
            return {**facts, "problem": problem}, {}
        if sizes.min() < 3 or sizes.sum() != len(corners):
            problem = f"{name} has {len(sizes)} faces with {sizes.sum()} corners, but {len(corners)} indices"
            return {**facts, "problem": problem}, {}
        if corners.min() < 0 or corners.max() >= len(points):
            problem = f"{name} uses vertices {corners.min()} to {corners.max()} of {len(points)}"
            return {**facts, "problem": problem}, {}
        triangles = _fan(sizes)
        if mesh.GetOrientationAttr().Get() == UsdGeom.Tokens.leftHanded:
            triangles = triangles[:, ::-1]
        matrix = np.array(UsdGeom.Xformable(prim).ComputeLocalToWorldTransform(0.0))
        with np.errstate(invalid="ignore", over="ignore"):  # judged by the caller
            vertices.append(points @ matrix[:3, :3] + matrix[3, :3])  # USD multiplies rows
        faces.append(corners[triangles] + offset)
        owners.append(np.full(len(triangles), len(names)))
        names.append([prim.GetName(), name])
        uvs.append(_read_uvs(prim, corners, triangles))
        offset += len(points)
        polygons += int((sizes > 3).sum())
    if not faces:
        return {**facts, "problem": "it holds no mesh"}, {}
    has_unit = UsdGeom.StageHasAuthoredMetersPerUnit(stage)
    facts["unit"] = float(UsdGeom.GetStageMetersPerUnit(stage)) if has_unit else None
    facts["up"] = str(UsdGeom.GetStageUpAxis(stage)).lower()
    facts["polygons"] = polygons
    facts["picture"] = _find_picture(stage)
    facts["objects"] = names
    arrays = {
        "vertices": np.concatenate(vertices),
        "faces": np.concatenate(faces),
        "object_ids": np.concatenate(owners),
    }
    if all(uv is not None for uv in uvs):
        arrays["uvs"] = np.concatenate([uv for uv in uvs if uv is not None])
    return facts, arrays


def _load(part: str) -> Any:
    """A module of Pixar's library; they have no types."""
    return importlib.import_module(f"pxr.{part}")


def _fan(sizes: np.ndarray) -> np.ndarray:
    """Index of the corner of each triangle in the list of corners, shape (F, 3)."""
    start, count = np.cumsum(sizes) - sizes, sizes - 2
    owner = np.repeat(np.arange(len(sizes)), count)
    ordinal = np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count)
    first = start[owner]
    return np.column_stack([first, first + ordinal + 1, first + ordinal + 2])


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
    """The first picture that a shader refers to."""
    Sdf, UsdShade = _load("Sdf"), _load("UsdShade")

    for prim in stage.Traverse():
        if not prim.IsA(UsdShade.Shader):
            continue
        for attribute in prim.GetAttributes():
            value = attribute.Get()
            if isinstance(value, Sdf.AssetPath) and value.path.lower().endswith(_PICTURES):
                return str(value.path)
    return None
