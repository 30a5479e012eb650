"""glTF 2.0, binary (GLB) and text, with its base colour picture.

Read here and not by trimesh, which applies no skins, knows no second set of texture coordinates,
and encodes pictures again.
"""

from __future__ import annotations

import base64
import json
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from dgl_assets.importing.bounds import (
    MAX_BUFFER_BYTES,
    check_count,
    check_size,
)
from dgl_assets.importing.errors import UnreadableFileError
from dgl_assets.importing.paths import TEXTURE_HINT, read_bytes, resolve_reference
from dgl_assets.importing.raw import RawMesh
from dgl_assets.importing.textures import load_texture, open_picture

_TYPES = {5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_COLUMNS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
_TRIANGLES = 4
_SPECULAR = "KHR_materials_pbrSpecularGlossiness"
_WEBP = "EXT_texture_webp"
_IGNORABLE = ("KHR_materials_", "KHR_texture_transform", "KHR_mesh_quantization", _WEBP)


def read_gltf(path: Path, *, use_textures: bool, root: Path | None = None) -> RawMesh:
    """Read a GLB or glTF file: its meshes in one, each where the nodes of its scene place it.

    A mesh with a skin is placed by its joints alone, as glTF says: transforms of its own node and
    above do not act.

    Args:
        path: Path of the file; buffers and pictures are looked for beside it.
        use_textures: Read the picture.
        root: Folder that references must not leave; that of the file by default.

    Raises:
        UnreadableFileError: If the file is cut off or contradicts itself.
        UnsafePathError: If it refers to files outside the root.

    Limitations:
        Morph targets and transforms of textures are not applied. Of several pictures one is kept.
    """
    return _GltfReader(path, root).read(use_textures=use_textures)


def check_gltf(path: Path) -> None:
    """Check what trimesh does not: the container, required extensions, and the tree of nodes."""
    for _ in _GltfReader(path, None).walk():
        pass


class _GltfReader:
    def __init__(self, path: Path, root: Path | None) -> None:
        self._path, self._name, self._root = path, path.name, root
        document, self._blob = _open_container(path.name, read_bytes(path))
        tree = json.loads(document.decode("utf-8-sig"))
        if not isinstance(tree, dict) or not isinstance(tree.get("asset"), dict):
            raise UnreadableFileError(f"{path.name} is JSON, but no glTF: it has no asset")
        self._tree = tree
        needed = [n for n in tree.get("extensionsRequired", []) if not n.startswith(_IGNORABLE)]
        if needed:
            raise UnreadableFileError(
                f"{path.name} needs the glTF extensions {', '.join(needed)[:100]}, which are not "
                "read; export it without"
            )
        self._files: dict[str, bytes] = {}
        self._arrays: dict[int, np.ndarray] = {}
        self._poses: dict[int, np.ndarray] = {}
        self._parents: dict[int, int] = {}
        for index, node in enumerate(tree.get("nodes", [])):
            for child in node.get("children", []):
                if self._parents.setdefault(child, index) != index:
                    raise UnreadableFileError(f"{path.name}: node {child} has two parents")

    def read(self, *, use_textures: bool) -> RawMesh:
        vertices, faces, uvs = [], [], []
        objects: dict[tuple[str, ...], int] = {}
        object_ids, pictures = [], {}
        offset = count = 0
        for names, node, primitive in self.walk():
            points, triangles = self._read_triangles(primitive)
            offset, count = offset + len(points), count + len(triangles)
            check_size(offset, count, f"{self._name}, each mesh as often as it is shown,")
            with np.errstate(invalid="ignore", over="ignore"):  # judged with all vertices
                vertices.append(self._place(node, primitive, points))
            faces.append(triangles + offset - len(points))
            object_ids.append(np.full(len(triangles), objects.setdefault(names, len(objects))))
            picture, uv = self._read_material(primitive, len(points))
            uvs.append(None if uv is None else uv[triangles])
            if picture is not None:
                pictures[picture] = pictures.get(picture, 0) + len(triangles)
        if not faces:
            raise UnreadableFileError(f"{self._name} holds no mesh that its scene shows")
        if use_textures:
            self._check_pictures()
        texture, notes = None, []
        has_uvs = all(uv is not None for uv in uvs)
        if use_textures and pictures and has_uvs:
            chosen = max(pictures, key=lambda index: pictures[index])
            texture = load_texture(self._get_picture(chosen), f"of {self._name}")
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

    # Nodes -----------------------------------------------------------------------------------

    def walk(self) -> Iterator[tuple[tuple[str, ...], int, dict[str, Any]]]:
        """Yield the names, the node and the content of each primitive that the scene shows."""
        roots = [k for k in range(len(self._tree.get("nodes", []))) if k not in self._parents]
        if self._tree.get("scenes"):
            roots = self._item("scenes", self._tree.get("scene", 0)).get("nodes", [])
        waiting, seen = [*reversed(roots)], set()
        while waiting:
            index = waiting.pop()
            if index in seen:
                raise UnreadableFileError(f"{self._name}: nodes form a circle")
            seen.add(index)
            node = self._item("nodes", index)
            if "mesh" in node:
                mesh = self._item("meshes", node["mesh"])
                found = (node.get("name"), mesh.get("name"))
                names = tuple(dict.fromkeys(name for name in found if isinstance(name, str)))
                for primitive in mesh["primitives"]:
                    yield names, index, primitive
            waiting += reversed(node.get("children", []))

    def _get_pose(self, index: int) -> np.ndarray:
        """Pose of a node in the scene, shape (4, 4)."""
        if index not in self._poses:
            local = _read_matrix(self._item("nodes", index))
            above = self._parents.get(index)
            self._poses[index] = local if above is None else self._get_pose(above) @ local
        return self._poses[index]

    def _place(self, index: int, primitive: dict[str, Any], points: np.ndarray) -> np.ndarray:
        """Transform points by the node, or by the joints of its skin."""
        skin = self._item("nodes", index).get("skin")
        attributes = primitive["attributes"]
        if skin is None or "JOINTS_0" not in attributes:
            pose = self._get_pose(index)
            return points @ pose[:3, :3].T + pose[:3, 3]
        skin = self._item("skins", skin)
        poses = np.array([self._get_pose(joint) for joint in skin["joints"]])
        if "inverseBindMatrices" in skin:
            inverse = self._decode(skin["inverseBindMatrices"]).astype(np.float64)
            poses = poses @ inverse[: len(poses)].reshape(-1, 4, 4).transpose(0, 2, 1)
        placed, total = np.zeros_like(points), np.zeros((len(points), 1))
        for number in range(sum(key.startswith("JOINTS_") for key in attributes)):
            joints = self._decode(attributes[f"JOINTS_{number}"])
            weights = self._decode(attributes[f"WEIGHTS_{number}"]).astype(np.float64)
            for joint, weight in zip(joints.T, weights.T[..., None], strict=True):
                pose = poses[joint]
                placed += weight * (
                    np.einsum("nij,nj->ni", pose[:, :3, :3], points) + pose[:, :3, 3]
                )
                total += weight
        if not total.all():
            raise UnreadableFileError(f"{self._name}: vertices of a skin have no weights")
        return placed / total

    # Meshes ----------------------------------------------------------------------------------

    def _read_triangles(self, primitive: dict[str, Any]) -> tuple[np.ndarray, np.ndarray]:
        if primitive.get("mode", _TRIANGLES) != _TRIANGLES:
            raise UnreadableFileError(
                f"{self._name}: a mesh is not made of triangles (mode {primitive['mode']})"
            )
        points = self._decode(primitive["attributes"]["POSITION"]).astype(np.float64)
        corners = np.arange(len(points))
        if "indices" in primitive:
            corners = self._decode(primitive["indices"]).ravel().astype(np.int64)
        if points.shape[1] != 3 or len(corners) % 3:
            raise UnreadableFileError(
                f"{self._name}: positions and triangles need three numbers each; got "
                f"{points.shape[1]} and {len(corners)} corners"
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
            material = self._item("materials", primitive["material"])
            colour = material.get("pbrMetallicRoughness", {}).get("baseColorTexture")
            if colour is None:
                specular = material.get("extensions", {}).get(_SPECULAR, {})
                colour = specular.get("diffuseTexture")
            if colour is not None:
                texture = self._item("textures", colour["index"])
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

    # Bytes -----------------------------------------------------------------------------------

    def _decode(self, index: int) -> np.ndarray:
        """Items of an accessor, shape (count, columns)."""
        if index in self._arrays:
            return self._arrays[index]
        accessor = self._item("accessors", index)
        if "sparse" in accessor or "bufferView" not in accessor:
            raise UnreadableFileError(
                f"{self._name}: accessor {index} is sparse, which is not read"
            )
        view = self._item("bufferViews", accessor["bufferView"])
        kind = np.dtype(_TYPES[accessor["componentType"]])
        columns = _COLUMNS[accessor["type"]]
        array = np.ndarray(
            (int(accessor["count"]), columns),
            kind,
            self._slice(view),
            int(accessor.get("byteOffset", 0)),
            (int(view.get("byteStride", kind.itemsize * columns)), kind.itemsize),
        )
        if accessor.get("normalized") is True and kind.kind in "iu":
            array = np.maximum(array / np.iinfo(kind).max, -1.0)
        self._arrays[index] = array
        return array

    def _slice(self, view: dict[str, Any]) -> memoryview:
        """Bytes of a buffer view."""
        buffer = self._item("buffers", view["buffer"])
        uri, promised = buffer.get("uri"), int(buffer["byteLength"])
        body = (self._blob or b"") if uri is None else self._fetch(uri)
        start, length = int(view.get("byteOffset", 0)), int(view["byteLength"])
        if promised > len(body) or start < 0 or not 0 <= length <= promised - start:
            raise UnreadableFileError(
                f"{self._name} is cut off or broken: bytes {start:,} to {start + length:,} are "
                f"promised of a buffer of {promised:,}, and {len(body):,} are there"
            )
        return memoryview(body)[start : start + length]

    def _get_picture(self, index: int) -> bytes:
        image = self._item("images", index)
        if image.get("uri") is not None:
            return self._fetch(image["uri"], TEXTURE_HINT)
        return bytes(self._slice(self._item("bufferViews", image["bufferView"])))

    def _check_pictures(self) -> None:
        """Check that each picture of the file, shown or not, is one; a file may name one often."""
        seen: set[object] = set()
        for index, image in enumerate(self._tree.get("images", [])):
            key = image.get("uri", image.get("bufferView"))
            if key not in seen:
                seen.add(key)
                open_picture(self._get_picture(index), f"of {self._name}").close()

    def _item(self, key: str, index: Any) -> dict[str, Any]:
        items = self._tree.get(key, [])
        if type(index) is not int or not 0 <= index < len(items):
            raise UnreadableFileError(
                f"{self._name} refers to item {index!r} of {len(items)} {key}"
            )
        return items[index]

    def _fetch(self, uri: str, hint: str = "") -> bytes:
        """Read what the document refers to, each file once."""
        if uri not in self._files:
            if uri.startswith("data:"):
                data = base64.b64decode(uri.partition(",")[2], validate=True)
            else:
                data = read_bytes(
                    resolve_reference(
                        self._path.parent, uri, named_by=self._name, root=self._root, hint=hint
                    )
                )
            self._files[uri] = data
            total = sum(map(len, self._files.values()))
            check_count(total, MAX_BUFFER_BYTES, "bytes in other files", self._name)
        return self._files[uri]


def _open_container(name: str, data: bytes) -> tuple[bytes, bytes | None]:
    """Split a GLB into its document and its bytes; of text, give the document."""
    if data[:4] != b"glTF":
        return data, None
    version, length = struct.unpack_from("<II", data, 4)
    if version != 2:
        raise UnreadableFileError(f"{name} is glTF version {version}; version 2 is read")
    chunks, offset = {}, 12
    while offset + 8 <= len(data):
        size, kind = struct.unpack_from("<I4s", data, offset)
        chunks.setdefault(kind, data[offset + 8 : offset + 8 + size])
        offset += 8 + size
    if length != len(data) or offset > length or b"JSON" not in chunks:
        raise UnreadableFileError(
            f"{name} is cut off or broken: its header promises {length:,} bytes, "
            f"{len(data):,} are there, its chunks take {offset:,}"
        )
    return chunks[b"JSON"], chunks.get(b"BIN\0")


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
