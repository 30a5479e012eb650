"""glTF 2.0, binary (GLB) and text, with its base colour picture."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from dgl_assets.importing.errors import UnreadableFileError
from dgl_assets.importing.gltf_file import COLUMNS, COMPONENT_TYPES, GltfFile, open_gltf
from dgl_assets.importing.raw import RawMesh, Texture
from dgl_assets.importing.textures import load_texture

_SPECULAR = "KHR_materials_pbrSpecularGlossiness"
_WEBP = "EXT_texture_webp"


def read_gltf(path: Path, data: bytes, *, use_textures: bool, root: Path | None = None) -> RawMesh:
    """Read a GLB or glTF file: its meshes in one, each where the nodes of its scene place it.

    Args:
        path: Of the file; buffers and pictures are looked for beside it.
        data: The file.
        use_textures: Whether to read the picture.
        root: Folder that references must not leave; that of the file by default.

    Raises:
        UnreadableFileError: If the file is cut off or contradicts itself.
        UnsafePathError: If it refers to files outside the root.

    Limitations:
        Skins, morph targets and transforms of textures are not applied. Of several pictures one is kept.
    """
    file = open_gltf(path, data, use_textures=use_textures, root=root)
    try:
        return _Reader(path.name, file).read(use_textures=use_textures)
    except (ArithmeticError, AttributeError, IndexError, KeyError, TypeError, ValueError) as err:
        raise UnreadableFileError(
            f"{path.name} is no valid glTF ({type(err).__name__}: {str(err)[:100]})"
        ) from err


class _Reader:
    def __init__(self, name: str, file: GltfFile) -> None:
        self._name, self._file, self._tree = name, file, file.tree
        self._arrays: dict[int, np.ndarray] = {}

    def read(self, *, use_textures: bool) -> RawMesh:
        vertices, faces, uvs = [], [], []
        objects: dict[tuple[str, ...], int] = {}
        object_ids, pictures = [], {}
        offset = parts = 0
        for names, matrix, primitive in self._walk():
            points, triangles = self._read_triangles(primitive)
            with np.errstate(invalid="ignore", over="ignore"):  # judged with all vertices
                points = points @ matrix[:3, :3].T + matrix[:3, 3]
            vertices.append(points)
            faces.append(triangles + offset)
            offset += len(points)
            object_ids.append(np.full(len(triangles), objects.setdefault(names, len(objects))))
            picture, uv = self._read_material(primitive, len(points))
            uvs.append(None if uv is None else uv[triangles])
            if picture is not None:
                pictures[picture] = pictures.get(picture, 0) + len(triangles)
                parts += 1
        if not faces:
            raise UnreadableFileError(f"{self._name} holds no mesh that its scene shows")
        texture: Texture | None = None
        notes: list[str] = []
        has_uvs = all(uv is not None for uv in uvs)
        if use_textures and pictures and has_uvs:
            chosen = max(pictures, key=lambda index: pictures[index])
            texture = load_texture(self._file.get_picture(chosen), f"of {self._name}")
            if len(pictures) > 1:
                notes.append(f"of {len(pictures)} pictures only that on most faces was kept")
        elif use_textures and pictures:
            notes.append("texture left out: a part has no texture coordinates")
        return RawMesh(
            vertices=np.concatenate(vertices),
            faces=np.concatenate(faces),
            uvs=np.concatenate([uv for uv in uvs if uv is not None]) if has_uvs else None,
            texture=texture,
            unit=1.0,  # by the standard
            up="y",
            notes=tuple(notes),
            objects=tuple(objects),
            object_ids=np.concatenate(object_ids),
        )

    def _walk(self) -> Iterator[tuple[tuple[str, ...], np.ndarray, dict[str, Any]]]:
        """Names, pose and content of each primitive that the scene shows."""
        nodes, meshes = self._tree.get("nodes", []), self._tree.get("meshes", [])
        waiting = [(root, np.eye(4)) for root in reversed(self._file.roots)]
        while waiting:
            index, above = waiting.pop()
            node = nodes[index]
            with np.errstate(invalid="ignore", over="ignore"):
                matrix = above @ _read_matrix(node)
            if "mesh" in node:
                mesh = meshes[node["mesh"]]
                found = (node.get("name"), mesh.get("name"))
                names = tuple(dict.fromkeys(name for name in found if isinstance(name, str)))
                for primitive in mesh["primitives"]:
                    yield names, matrix, primitive
            waiting += [(child, matrix) for child in reversed(node.get("children", []))]

    def _read_triangles(self, primitive: dict[str, Any]) -> tuple[np.ndarray, np.ndarray]:
        points = self._decode(primitive["attributes"]["POSITION"]).astype(np.float64)
        if "indices" in primitive:
            corners = self._decode(primitive["indices"]).ravel().astype(np.int64)
        else:
            corners = np.arange(len(points))
        if len(corners) % 3:
            raise UnreadableFileError(
                f"{self._name}: triangles need three corners each; got {len(corners)} corners"
            )
        if len(corners) and not 0 <= corners.min() <= corners.max() < len(points):
            raise UnreadableFileError(
                f"{self._name}: a mesh uses vertex {corners.max()} of {len(points)}"
            )
        return points, corners.reshape(-1, 3)

    def _read_material(
        self, primitive: dict[str, Any], count: int
    ) -> tuple[int | None, np.ndarray | None]:
        """Index of the picture, and texture coordinates, v upwards, shape (V, 2)."""
        picture, channel = None, 0
        if "material" in primitive:
            material = self._tree["materials"][primitive["material"]]
            colour = material.get("pbrMetallicRoughness", {}).get("baseColorTexture")
            if colour is None:
                specular = material.get("extensions", {}).get(_SPECULAR, {})
                colour = specular.get("diffuseTexture")
            if colour is not None:
                texture = self._tree["textures"][colour["index"]]
                webp = texture.get("extensions", {}).get(_WEBP, {})
                picture = webp.get("source", texture.get("source"))
                channel = colour.get("texCoord", 0)
        index = primitive["attributes"].get(f"TEXCOORD_{channel}")
        if index is None:
            return picture, None
        uvs = self._decode(index)
        if uvs.shape != (count, 2):
            raise UnreadableFileError(
                f"{self._name}: texture coordinates must have shape ({count}, 2); got {uvs.shape}"
            )
        return picture, np.column_stack([uvs[:, 0], 1.0 - uvs[:, 1].astype(np.float64)])

    def _decode(self, index: int) -> np.ndarray:
        """Items of an accessor, shape (count, columns)."""
        if index in self._arrays:
            return self._arrays[index]
        accessor = self._tree["accessors"][index]
        view = self._tree["bufferViews"][accessor["bufferView"]]
        kind = np.dtype(COMPONENT_TYPES[accessor["componentType"]])
        count, columns = int(accessor["count"]), COLUMNS[accessor["type"]]
        array = np.ndarray(
            (count, columns),
            kind,
            self._file.slice_view(accessor["bufferView"]),
            int(accessor.get("byteOffset", 0)),
            (int(view.get("byteStride", kind.itemsize * columns)), kind.itemsize),
        )
        if accessor.get("normalized") is True and kind.kind in "iu":
            array = np.maximum(array / np.iinfo(kind).max, -1.0)
        self._arrays[index] = array
        return array


def _read_matrix(node: dict[str, Any]) -> np.ndarray:
    """Pose of a node in its parent, shape (4, 4)."""
    if "matrix" in node:
        return np.array(node["matrix"], dtype=np.float64).reshape(4, 4).T
    matrix = np.eye(4)
    scale = np.array(node.get("scale", (1, 1, 1)), dtype=np.float64).reshape(3)
    turn = np.array(node.get("rotation", (0, 0, 0, 1)), dtype=np.float64).reshape(4)
    length = np.linalg.norm(turn)
    if not length > 1e-12:
        raise ValueError("a rotation must be a unit quaternion")
    matrix[:3, :3] = Rotation.from_quat(turn / length).as_matrix() * scale
    matrix[:3, 3] = np.array(node.get("translation", (0, 0, 0)), dtype=np.float64).reshape(3)
    return matrix
