"""What a glTF 2.0 file claims, checked against its bytes and against limits before anything is decoded."""

from __future__ import annotations

import base64
import binascii
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dgl_assets.importing.bounds import (
    MAX_BUFFER_BYTES,
    MAX_DEPTH,
    MAX_ITEMS,
    MAX_PICTURES,
    check_count,
    check_size,
)
from dgl_assets.importing.errors import UnreadableFileError
from dgl_assets.importing.paths import TEXTURE_HINT, parse_json, read_bytes, resolve_reference
from dgl_assets.importing.textures import open_picture

COMPONENT_TYPES = {5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
"""Type of a number by its code."""
COLUMNS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
"""Numbers of an item by its type."""
_IGNORABLE = (
    "KHR_materials_",
    "KHR_texture_transform",
    "KHR_mesh_quantization",
    "EXT_texture_webp",
)
_TRIANGLES = 4
_WRONG = (
    ArithmeticError, AttributeError, IndexError, KeyError, RecursionError, TypeError, ValueError,
)  # fmt: skip


@dataclass(frozen=True, kw_only=True, eq=False)
class GltfFile:
    """A file whose claims hold."""

    tree: dict[str, Any]
    """The document."""
    buffers: tuple[bytes, ...]
    files: dict[str, bytes]
    """What it refers to, by reference."""
    roots: tuple[int, ...]
    """Nodes that its scene shows."""

    def slice_view(self, index: int) -> bytes:
        """Bytes of a buffer view."""
        view = self.tree["bufferViews"][index]
        start = int(view.get("byteOffset", 0))
        return self.buffers[view["buffer"]][start : start + int(view["byteLength"])]

    def get_picture(self, index: int) -> bytes:
        """The file of a picture."""
        image = self.tree["images"][index]
        if image.get("uri") is not None:
            return self.files[image["uri"]]
        return self.slice_view(image["bufferView"])


def open_gltf(path: Path, data: bytes, *, use_textures: bool, root: Path | None = None) -> GltfFile:
    """Open a GLB or glTF file and check every claim.

    Args:
        path: Of the file; buffers and pictures are looked for beside it.
        data: The file.
        use_textures: Whether to look for pictures.
        root: Folder that references must not leave; that of the file by default.

    Raises:
        UnreadableFileError: If the file is cut off, contradicts itself or goes beyond a limit.
        UnsafePathError: If it refers to files outside the root.
    """
    document, blob = _open_binary(path.name, data) if data[:4] == b"glTF" else (data, None)
    tree = parse_json(document, path.name)
    if not isinstance(tree, dict) or not isinstance(tree.get("asset"), dict):
        raise UnreadableFileError(f"{path.name} is JSON, but no glTF: it has no asset")
    try:
        return _Checker(path, tree, blob, root).check(use_textures=use_textures)
    except _WRONG as err:
        raise UnreadableFileError(
            f"{path.name} is no valid glTF ({type(err).__name__}: {str(err)[:100]})"
        ) from err


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
    document: bytes | None = None
    offset = 12
    while offset + 8 <= length:
        size, kind = struct.unpack_from("<I4s", data, offset)
        if offset + 8 + size > length:
            raise UnreadableFileError(
                f"{name}: a chunk of {size:,} bytes does not fit into the file"
            )
        body = slice(offset + 8, offset + 8 + size)
        if document is None:
            if kind != b"JSON":
                break
            document = data[body]
        elif kind == b"BIN\0":
            return document, data[body]
        offset += 8 + size
    if document is None:
        raise UnreadableFileError(f"{name}: the first chunk of a GLB must be JSON")
    return document, None


class _Checker:
    def __init__(
        self, path: Path, tree: dict[str, Any], blob: bytes | None, root: Path | None
    ) -> None:
        self._path, self._name, self._tree = path, path.name, tree
        self._blob, self._root = blob, root
        self._files: dict[str, bytes] = {}
        self._buffers: list[bytes] = []

    def check(self, *, use_textures: bool) -> GltfFile:
        needed = [
            name
            for name in self._tree.get("extensionsRequired", [])
            if not name.startswith(_IGNORABLE)
        ]
        if needed:
            raise UnreadableFileError(
                f"{self._name} needs the glTF extensions {', '.join(needed)[:100]}, which are not read; export it "
                "without"
            )
        for key, items in self._tree.items():
            if isinstance(items, list):
                check_count(len(items), MAX_ITEMS, key[:40], self._name)
        self._check_buffers()
        self._check_accessors()
        sizes = self._check_meshes()
        roots = self._check_nodes(sizes)
        if use_textures:
            self._check_pictures()
        return GltfFile(
            tree=self._tree, buffers=tuple(self._buffers), files=self._files, roots=roots
        )

    def _check_buffers(self) -> None:
        for index, buffer in enumerate(self._tree.get("buffers", [])):
            uri = buffer.get("uri")
            body = (self._blob or b"") if uri is None else self._fetch(uri)
            if not 0 <= int(buffer["byteLength"]) <= len(body):
                raise UnreadableFileError(
                    f"{self._name}: buffer {index} promises {buffer['byteLength']:,} bytes, {len(body):,} are there"
                )
            self._buffers.append(body)
        for index, view in enumerate(self._tree.get("bufferViews", [])):
            start, length = int(view.get("byteOffset", 0)), int(view["byteLength"])
            size = int(self._item("buffers", view["buffer"])["byteLength"])
            if start < 0 or length < 0 or start + length > size:
                raise UnreadableFileError(
                    f"{self._name}: buffer view {index} reaches beyond its buffer"
                )

    def _check_accessors(self) -> None:
        total = 0
        for index, accessor in enumerate(self._tree.get("accessors", [])):
            what = f"{self._name}: accessor {index}"
            count = int(accessor["count"])
            item = int(COMPONENT_TYPES[accessor["componentType"]][-1]) * COLUMNS[accessor["type"]]
            if count < 0 or "sparse" in accessor:
                raise UnreadableFileError(
                    f"{what} has a negative count"
                    if count < 0
                    else f"{what} is sparse, which is not read"
                )
            if "bufferView" not in accessor:
                raise UnreadableFileError(f"{what} has no data")
            view = self._item("bufferViews", accessor["bufferView"])
            stride = int(view.get("byteStride", item))
            offset = int(accessor.get("byteOffset", 0))
            end = offset + (stride * (count - 1) + item if count else 0)
            if offset < 0 or stride < item or end > int(view["byteLength"]):
                raise UnreadableFileError(
                    f"{what} promises {count:,} items, which do not fit into its buffer view"
                )
            total += count * item
        check_count(total, MAX_BUFFER_BYTES, "bytes of accessors", self._name)

    def _check_meshes(self) -> list[tuple[int, int]]:
        """Check the meshes; return the vertices and faces of each."""
        sizes, parts = [], 0
        for index, mesh in enumerate(self._tree.get("meshes", [])):
            vertices = faces = 0
            parts += len(mesh["primitives"])
            check_count(parts, MAX_ITEMS, "primitives", self._name)
            for number, primitive in enumerate(mesh["primitives"]):
                where = f"{self._name}: mesh {index}, primitive {number}"
                if primitive.get("mode", _TRIANGLES) != _TRIANGLES:
                    raise UnreadableFileError(
                        f"{where} is not made of triangles (mode {primitive['mode']})"
                    )
                positions = self._item("accessors", primitive["attributes"]["POSITION"])
                if positions["type"] != "VEC3":
                    raise UnreadableFileError(f"{where} has positions that are not three numbers")
                corners = positions["count"]
                if "indices" in primitive:
                    indices = self._item("accessors", primitive["indices"])
                    if indices["type"] != "SCALAR":
                        raise UnreadableFileError(f"{where} has indices that are no numbers")
                    corners = indices["count"]
                vertices, faces = vertices + int(positions["count"]), faces + int(corners) // 3
            sizes.append((vertices, faces))
        if not sum(vertices for vertices, _ in sizes):
            raise UnreadableFileError(f"{self._name} holds no mesh")
        check_size(sum(size[0] for size in sizes), sum(size[1] for size in sizes), self._name)
        return sizes

    def _check_nodes(self, sizes: list[tuple[int, int]]) -> tuple[int, ...]:
        """Nodes must form trees of limited depth that show a limited mesh; return the roots of the scene."""
        nodes = self._tree.get("nodes", [])
        parents: dict[int, int] = {}
        for index, node in enumerate(nodes):
            for child in node.get("children", []):
                if not 0 <= child < len(nodes) or child in parents:
                    raise UnreadableFileError(
                        f"{self._name}: node {index} has the child {child}, which is not its alone"
                    )
                parents[child] = index
        scenes = self._tree.get("scenes", [])
        roots = [index for index in range(len(nodes)) if index not in parents]
        if nodes and not roots:
            raise UnreadableFileError(f"{self._name}: the nodes around node 0 form a circle")
        if scenes:
            roots = self._item("scenes", self._tree.get("scene", 0)).get("nodes", [])
        check_count(len(roots), MAX_ITEMS, "nodes of a scene", self._name)
        vertices = faces = 0
        waiting, seen = [(root, 1) for root in roots], set()
        while waiting:
            index, depth = waiting.pop()
            node = self._item("nodes", index)
            if index in seen:
                raise UnreadableFileError(
                    f"{self._name}: the nodes around node {index} form a circle"
                )
            seen.add(index)
            if depth > MAX_DEPTH:
                raise UnreadableFileError(
                    f"{self._name}: nodes are nested more than {MAX_DEPTH} deep"
                )
            if "mesh" in node:
                self._item("meshes", node["mesh"])
                vertices, faces = (
                    vertices + sizes[node["mesh"]][0],
                    faces + sizes[node["mesh"]][1],
                )
            waiting += [(child, depth + 1) for child in node.get("children", [])]
        check_size(vertices, faces, f"{self._name}, each mesh as often as it is shown,")
        return tuple(roots)

    def _check_pictures(self) -> None:
        """Look at each picture once: a file may name one very often."""
        seen: set[tuple[int, int, int] | str] = set()
        for image in self._tree.get("images", []):
            uri = image.get("uri")
            if uri is not None:
                key, body = uri, self._fetch(uri, TEXTURE_HINT)
            else:
                view = self._item("bufferViews", image["bufferView"])
                start, length = int(view.get("byteOffset", 0)), int(view["byteLength"])
                key = (int(view["buffer"]), start, length)
                body = b"" if key in seen else self._buffers[key[0]][start : start + length]
            if key in seen:
                continue
            seen.add(key)
            check_count(len(seen), MAX_PICTURES, "pictures", self._name)
            open_picture(body, f"of {self._name}").close()

    def _item(self, key: str, index: Any) -> dict[str, Any]:
        items = self._tree.get(key, [])
        if type(index) is not int or not 0 <= index < len(items):
            raise ValueError(f"there is no {index!r} of {len(items)} {key}")
        return items[index]

    def _fetch(self, uri: str, hint: str = "") -> bytes:
        if uri in self._files:
            return self._files[uri]
        if uri.startswith("data:"):
            head, _, body = uri.partition(",")
            try:
                data = base64.b64decode(body, validate=True) if head.endswith(";base64") else b""
            except binascii.Error as err:
                raise UnreadableFileError(
                    f"{self._name}: data of a buffer is broken ({err})"
                ) from err
        else:
            data = read_bytes(
                resolve_reference(
                    self._path.parent, uri, named_by=self._name, root=self._root, hint=hint
                )
            )
        self._files[uri] = data
        check_count(
            sum(map(len, self._files.values())),
            MAX_BUFFER_BYTES,
            "bytes in other files",
            self._name,
        )
        return data
