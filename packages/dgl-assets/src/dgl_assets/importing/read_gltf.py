"""glTF 2.0, binary (GLB) and text, with its base colour picture.

Everything that the file claims is checked against its bytes first; then trimesh decodes it.
"""

from __future__ import annotations

import base64
import binascii
import io
import struct
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from trimesh.resolvers import Resolver

from dgl_assets.importing.errors import UnreadableFileError
from dgl_assets.importing.paths import TEXTURE_HINT, parse_json, read_bytes, resolve_reference
from dgl_assets.importing.raw import RawMesh, Texture, check_size
from dgl_assets.importing.textures import encode_texture, load_texture

_COMPONENT_BYTES = {5120: 1, 5121: 1, 5122: 2, 5123: 2, 5125: 4, 5126: 4}
_COLUMNS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
_IGNORABLE = (
    "KHR_materials_",
    "KHR_texture_transform",
    "KHR_mesh_quantization",
    "EXT_texture_webp",
)
_TRIANGLES = 4


def read_gltf(path: Path, data: bytes, *, use_textures: bool) -> RawMesh:
    """Read a GLB or glTF file.

    Args:
        path: Of the file; buffers and pictures are looked for beside it.
        data: The file.
        use_textures: Whether to read the picture.

    Raises:
        UnreadableFileError: If the file is cut off or contradicts itself.
        UnsafePathError: If it refers to files outside its folder.
    """
    is_binary = data[:4] == b"glTF"
    document, blob = _open_binary(path.name, data) if is_binary else (data, None)
    tree = parse_json(document, path.name)
    if not isinstance(tree, dict) or not isinstance(tree.get("asset"), dict):
        raise UnreadableFileError(f"{path.name} is JSON, but no glTF: it has no asset")
    try:
        files = _check(path, tree, blob, use_textures=use_textures)
    except (AttributeError, IndexError, KeyError, TypeError, ValueError) as err:
        raise UnreadableFileError(
            f"{path.name} is no valid glTF ({type(err).__name__}: {str(err)[:100]})"
        ) from err
    try:
        scene = trimesh.load_scene(
            io.BytesIO(data),
            file_type="glb" if is_binary else "gltf",
            resolver=_Files(files),
            process=False,
            skip_materials=not use_textures,
        )
        return _collect(path.name, scene, use_textures=use_textures)
    except UnreadableFileError:
        raise
    except Exception as err:  # the decoder raises anything on broken files
        raise UnreadableFileError(
            f"{path.name} cannot be decoded as glTF ({type(err).__name__}: {str(err)[:100]})"
        ) from err


class _Files(Resolver):
    """Gives the decoder the files that were checked, and no others."""

    def __init__(self, files: dict[str, bytes]) -> None:
        self._files = files

    def get(self, key: str) -> bytes:
        return self._files[key]

    def write(self, name: str, data: object) -> None:
        raise NotImplementedError("this resolver only reads")

    def namespaced(self, namespace: str) -> _Files:
        raise NotImplementedError("this resolver has one folder")

    def keys(self) -> list[str]:
        return list(self._files)


def _open_binary(name: str, data: bytes) -> tuple[bytes, bytes | None]:
    if len(data) < 20:
        raise UnreadableFileError(
            f"{name} is cut off: a GLB has at least 20 bytes, this has {len(data)}"
        )
    version, length = struct.unpack_from("<II", data, 4)
    if version != 2:
        raise UnreadableFileError(f"{name} is glTF version {version}; version 2 is read")
    if length != len(data):
        raise UnreadableFileError(
            f"{name} is cut off or broken: its header promises {length:,} bytes, {len(data):,} are there"
        )
    chunks, offset = [], 12
    while offset + 8 <= length:
        size, kind = struct.unpack_from("<I4s", data, offset)
        if offset + 8 + size > length:
            raise UnreadableFileError(
                f"{name}: a chunk of {size:,} bytes does not fit into the file"
            )
        chunks.append((kind, data[offset + 8 : offset + 8 + size]))
        offset += 8 + size
    if not chunks or chunks[0][0] != b"JSON":
        raise UnreadableFileError(f"{name}: the first chunk of a GLB must be JSON")
    return chunks[0][1], next((body for kind, body in chunks[1:] if kind == b"BIN\0"), None)


def _check(
    path: Path, tree: dict[str, Any], blob: bytes | None, *, use_textures: bool
) -> dict[str, bytes]:
    """Check every claim; return the outside files that the decoder may read."""
    needed = [
        name for name in tree.get("extensionsRequired", []) if not name.startswith(_IGNORABLE)
    ]
    if needed:
        raise UnreadableFileError(
            f"{path.name} needs the glTF extensions {', '.join(needed)[:100]}, which are not read; export it without"
        )
    files: dict[str, bytes] = {}
    sizes = []
    for index, buffer in enumerate(tree.get("buffers", [])):
        uri = buffer.get("uri")
        body = (blob or b"") if uri is None else _fetch(path, uri, files)
        if len(body) < int(buffer["byteLength"]):
            raise UnreadableFileError(
                f"{path.name}: buffer {index} promises {buffer['byteLength']:,} bytes, {len(body):,} are there"
            )
        sizes.append(int(buffer["byteLength"]))
    views = tree.get("bufferViews", [])
    for index, view in enumerate(views):
        start, length = int(view.get("byteOffset", 0)), int(view["byteLength"])
        if start < 0 or length < 0 or start + length > sizes[view["buffer"]]:
            raise UnreadableFileError(f"{path.name}: buffer view {index} reaches beyond its buffer")
    for index, accessor in enumerate(tree.get("accessors", [])):
        _check_accessor(path.name, index, accessor, views)
    _check_meshes(path.name, tree)
    _check_nodes(path.name, tree.get("nodes", []))
    for image in tree.get("images", []):
        if use_textures and image.get("uri") is not None:
            load_texture(_fetch(path, image["uri"], files, TEXTURE_HINT), f"of {path.name}")
        elif use_textures:
            view = views[image["bufferView"]]
            if view["buffer"] == 0 and blob is not None:
                start = int(view.get("byteOffset", 0))
                load_texture(blob[start : start + int(view["byteLength"])], f"in {path.name}")
        elif image.get("uri") is not None:  # the decoder skips it but may ask
            files[image["uri"]] = b""
    return files


def _check_accessor(name: str, index: int, accessor: dict[str, Any], views: list[Any]) -> None:
    count = int(accessor["count"])
    item = _COMPONENT_BYTES[accessor["componentType"]] * _COLUMNS[accessor["type"]]
    if count < 0 or "sparse" in accessor:
        raise UnreadableFileError(
            f"{name}: accessor {index} "
            + ("has a negative count" if count < 0 else "is sparse, which is not read")
        )
    if "bufferView" not in accessor:
        raise UnreadableFileError(f"{name}: accessor {index} has no data")
    view = views[accessor["bufferView"]]
    stride = int(view.get("byteStride", item))
    offset = int(accessor.get("byteOffset", 0))
    end = offset + (stride * (count - 1) + item if count else 0)
    if offset < 0 or stride < item or end > int(view["byteLength"]):
        raise UnreadableFileError(
            f"{name}: accessor {index} promises {count:,} items, which do not fit into its buffer view"
        )


def _check_meshes(name: str, tree: dict[str, Any]) -> None:
    accessors = tree.get("accessors", [])
    vertices = corners = 0
    for index, mesh in enumerate(tree.get("meshes", [])):
        for number, primitive in enumerate(mesh["primitives"]):
            if primitive.get("mode", _TRIANGLES) != _TRIANGLES:
                raise UnreadableFileError(
                    f"{name}: mesh {index}, primitive {number} is not made of triangles (mode {primitive['mode']})"
                )
            positions = accessors[primitive["attributes"]["POSITION"]]
            if positions["type"] != "VEC3":
                raise UnreadableFileError(
                    f"{name}: positions of mesh {index} are not three numbers"
                )
            vertices += positions["count"]
            corners += accessors[primitive["indices"]]["count"] if "indices" in primitive else 0
    if not vertices:
        raise UnreadableFileError(f"{name} holds no mesh")
    check_size(vertices, corners // 3, name)


def _check_nodes(name: str, nodes: list[Any]) -> None:
    """Nodes must form trees: the decoder would follow a circle for ever."""
    parents: dict[int, int] = {}
    for index, node in enumerate(nodes):
        for child in node.get("children", []):
            if not 0 <= child < len(nodes) or child in parents:
                raise UnreadableFileError(
                    f"{name}: node {index} has the child {child}, which is not its alone"
                )
            parents[child] = index
    for index in range(len(nodes)):
        seen, here = {index}, index
        while here in parents:
            here = parents[here]
            if here in seen:
                raise UnreadableFileError(f"{name}: the nodes around node {here} form a circle")
            seen.add(here)
            if len(seen) > 1000:
                raise UnreadableFileError(f"{name}: nodes are nested more than 1,000 deep")


def _fetch(path: Path, uri: str, files: dict[str, bytes], hint: str = "") -> bytes:
    if uri.startswith("data:"):
        head, _, body = uri.partition(",")
        try:
            files[uri] = base64.b64decode(body, validate=True) if head.endswith(";base64") else b""
        except binascii.Error as err:
            raise UnreadableFileError(f"{path.name}: data of a buffer is broken ({err})") from err
        return files[uri]
    files[uri] = read_bytes(resolve_reference(path.parent, uri, named_by=path.name, hint=hint))
    return files[uri]


def _collect(name: str, scene: trimesh.Scene, *, use_textures: bool) -> RawMesh:
    """Put the meshes of a scene into one, each where its node places it."""
    vertices, faces, uvs, pictures = [], [], [], []
    offset = 0
    for node in scene.graph.nodes_geometry:
        matrix, geometry = scene.graph[node]
        mesh = scene.geometry[geometry]
        if not isinstance(mesh, trimesh.Trimesh):
            continue
        points = np.asarray(mesh.vertices, dtype=np.float64)
        triangles = np.asarray(mesh.faces, dtype=np.int64)
        if len(triangles) and not 0 <= triangles.min() <= triangles.max() < len(points):
            raise UnreadableFileError(
                f"{name}: mesh {geometry!r} uses vertex {triangles.max()} of {len(points)}"
            )
        with np.errstate(invalid="ignore", over="ignore"):  # judged with all vertices
            points = points @ np.asarray(matrix)[:3, :3].T + np.asarray(matrix)[:3, 3]
        vertices.append(points)
        faces.append(triangles + offset)
        offset += len(points)
        uv = getattr(mesh.visual, "uv", None)
        uvs.append(None if uv is None else np.asarray(uv, dtype=np.float64)[triangles])
        material = getattr(mesh.visual, "material", None)
        picture = getattr(material, "baseColorTexture", None)
        if picture is not None:
            pictures.append((len(triangles), picture))
    if not faces:
        raise UnreadableFileError(f"{name} holds no mesh that its scene shows")
    notes: list[str] = []
    texture: Texture | None = None
    if use_textures and pictures:
        texture = encode_texture(max(pictures, key=lambda item: item[0])[1])
        if len({id(picture) for _, picture in pictures}) > 1:
            notes.append(f"of {len(pictures)} pictures only that on most faces was kept")
    has_uvs = all(uv is not None for uv in uvs)
    if not has_uvs and texture is not None:
        texture = None
        notes.append("texture left out: a part has no texture coordinates")
    return RawMesh(
        vertices=np.concatenate(vertices),
        faces=np.concatenate(faces),
        uvs=np.concatenate([uv for uv in uvs if uv is not None]) if has_uvs else None,
        texture=texture,
        unit=1.0,  # by the standard
        up="y",
        notes=tuple(notes),
    )
