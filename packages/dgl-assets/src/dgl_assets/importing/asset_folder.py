"""The folder of an imported asset: mesh.obj, keypoints.json, meta.json, and what else it has.

A garment that was laid flat has `rest.obj`: the same triangles, unstrained. One with a picture has
`material.mtl` and `texture.png` or `texture.jpg`.
"""

from __future__ import annotations

import json
import reprlib
from pathlib import Path
from typing import Any

import numpy as np

from dgl_assets.errors import AssetNotFoundError
from dgl_assets.importing.errors import UnreadableFileError
from dgl_assets.importing.imported import ImportedGarment
from dgl_assets.importing.paths import read_bytes, read_json
from dgl_assets.importing.raw import ClothPicture, RawMesh, check_raw
from dgl_assets.importing.read_obj import read_obj
from dgl_assets.importing.source import KEYPOINTS_FILE, META_FILE

FORMAT = 1
"""Version of the folder's layout, in meta.json."""
MESH_FILE, REST_FILE, MATERIAL_FILE = "mesh.obj", "rest.obj", "material.mtl"
_THICKEST = 0.05  # wall of a hat or a glove [m]


def write_asset(
    folder: Path,
    *,
    vertices: np.ndarray,
    faces: np.ndarray,
    rest_vertices: np.ndarray | None,
    uvs: np.ndarray | None,
    texture: ClothPicture | None,
    landmarks: dict[str, int],
    meta: dict[str, Any],
) -> None:
    """Write the files of an asset into an empty folder.

    Args:
        folder: Folder to write into.
        vertices: Positions [m], shape (V, 3), garment frame.
        faces: Triangles, shape (F, 3), int.
        rest_vertices: Unstrained positions [m], shape (V, 3), if they differ.
        uvs: Texture coordinates of corners, shape (F, 3, 2).
        texture: Picture.
        landmarks: Vertex id of each named point.
        meta: Content of meta.json.
    """
    has_picture = texture is not None and uvs is not None
    _write_obj(folder / MESH_FILE, vertices, faces, uvs=uvs, use_material=has_picture)
    if rest_vertices is not None:
        _write_obj(folder / REST_FILE, rest_vertices, faces, uvs=None, use_material=False)
    if texture is not None and has_picture:
        (folder / f"texture{texture.suffix}").write_bytes(texture.data)
        (folder / MATERIAL_FILE).write_text(
            f"newmtl cloth\nKd 1 1 1\nmap_Kd texture{texture.suffix}\n", encoding="utf-8"
        )
    for name, tree in ((KEYPOINTS_FILE, landmarks), (META_FILE, {"format": FORMAT, **meta})):
        text = json.dumps(tree, indent=2, ensure_ascii=False, allow_nan=False)
        (folder / name).write_text(text + "\n", encoding="utf-8")


def load_asset(folder: str | Path) -> ImportedGarment:
    """Load an asset that `import_garment` has written.

    Args:
        folder: `<root>/<category>/<name>`.

    Returns:
        The garment; landmarks may have been edited since.

    Raises:
        AssetNotFoundError: If there is no asset.
        UnreadableFileError: If its files are broken or contradict each other.
    """
    folder = Path(folder)
    if not (folder / META_FILE).is_file() or not (folder / MESH_FILE).is_file():
        raise AssetNotFoundError(
            f"expected {META_FILE} and {MESH_FILE} of an imported asset in {folder}"
        )
    meta = read_json(folder / META_FILE)
    landmarks = read_json(folder / KEYPOINTS_FILE)
    if not isinstance(meta, dict) or meta.get("format") != FORMAT or "category" not in meta:
        raise UnreadableFileError(f"{folder / META_FILE} is not of format {FORMAT}")
    if not isinstance(landmarks, dict) or not all(type(v) is int for v in landmarks.values()):
        raise UnreadableFileError(f"{folder / KEYPOINTS_FILE} must map names to vertex ids")
    mesh = _read_obj(folder / MESH_FILE)
    rest = mesh
    if (folder / REST_FILE).is_file():
        rest = _read_obj(folder / REST_FILE)
        if not np.array_equal(rest.faces, mesh.faces):
            raise UnreadableFileError(f"{REST_FILE} has other faces than {MESH_FILE} in {folder}")
    elif meta.get("is_laid_flat"):
        raise UnreadableFileError(
            f"{folder / REST_FILE} is missing: the garment was laid flat, and its unstrained shape "
            "was there"
        )
    pictures = [folder / f"texture{suffix}" for suffix in (".png", ".jpg")]
    try:
        return ImportedGarment(
            name=folder.name,
            category=str(meta["category"]),
            vertices=mesh.vertices.astype(np.float32),
            faces=mesh.faces.astype(np.int32),
            rest_vertices=rest.vertices.astype(np.float32),
            landmarks=landmarks,
            uvs=None if mesh.uvs is None else mesh.uvs.astype(np.float32),
            texture=next((path for path in pictures if path.is_file()), None),
            wall_thickness=_read_thickness(meta, folder / META_FILE),
            meta=meta,
        )
    except ValueError as err:
        raise UnreadableFileError(f"{folder}: {err}") from err


def _read_obj(path: Path) -> RawMesh:
    mesh = read_obj(path, read_bytes(path), use_textures=False)
    check_raw(mesh, path.name)
    return mesh


def _read_thickness(meta: dict[str, Any], path: Path) -> float | None:
    value = meta.get("wall_thickness")
    if value is None:
        return None
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    if not is_number or not 0 < value <= _THICKEST:
        raise UnreadableFileError(
            f"{path}: wall_thickness must be above 0 and at most {_THICKEST} m, or null; got "
            f"{reprlib.repr(value)}"
        )
    return float(value)


def _write_obj(
    path: Path,
    vertices: np.ndarray,
    faces: np.ndarray,
    *,
    uvs: np.ndarray | None,
    use_material: bool,
) -> None:
    lines = [f"mtllib {MATERIAL_FILE}", "usemtl cloth"] if use_material else []
    lines += [f"v {x:.7f} {y:.7f} {z:.7f}" for x, y, z in vertices.tolist()]
    if uvs is None:
        lines += [f"f {a} {b} {c}" for a, b, c in (faces + 1).tolist()]
    else:
        places, index = np.unique(uvs.reshape(-1, 2).round(6), axis=0, return_inverse=True)
        lines += [f"vt {u:.6f} {v:.6f}" for u, v in places.tolist()]
        corners = np.stack([faces, index.reshape(-1, 3)], axis=2) + 1
        lines += [
            "f " + " ".join(f"{vertex}/{place}" for vertex, place in face)
            for face in corners.tolist()
        ]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
