"""Wavefront OBJ with its materials.

Read here and not by trimesh, so that vertices keep the numbers that landmarks refer to, objects
and groups keep their names, and errors name their line.
"""

from __future__ import annotations

import io
from array import array
from collections import Counter
from pathlib import Path

import numpy as np

from dgl_assets.importing.bounds import (
    MAX_OBJECTS,
    check_lines,
)
from dgl_assets.importing.errors import UnreadableFileError
from dgl_assets.importing.paths import TEXTURE_HINT, read_bytes, resolve_reference
from dgl_assets.importing.raw import ClothPicture, RawMesh, triangulate
from dgl_assets.importing.textures import load_texture

_MAX_UNUSED = 0.01  # of the vertices; OBJ has no other sign that its end is missing


def read_obj(path: Path, data: bytes, *, use_textures: bool, root: Path | None = None) -> RawMesh:
    """Read an OBJ file.

    Args:
        path: Path of the file; materials and pictures are looked for beside it.
        data: Content of the file.
        use_textures: Read materials.
        root: Folder that references must not leave; that of the file by default.

    Raises:
        UnreadableFileError: With the line that cannot be read.
        UnsafePathError: If a material or a picture lies outside the root.
    """
    check_lines(data, path.name)
    parser = _ObjParser(path.name)
    text = _decode(data)
    if "\\" in text:  # a line that ends in a backslash goes on in the next one
        text = text.replace("\\\r\n", " ").replace("\\\n", " ")
    for number, line in enumerate(io.StringIO(text, newline=None), start=1):
        parser.read_line(number, line)
    return parser.finish(path, use_textures=use_textures, root=root)


def _decode(data: bytes) -> str:
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("latin-1")  # comments and names in an old code page


class _ObjParser:
    def __init__(self, name: str) -> None:
        self._name = name
        self._vertices, self._coordinates = array("d"), array("d")
        self._sizes = array("q")  # corners of each polygon
        self._corners = array("q")  # vertex and texture coordinate of each corner, -1 for none
        self._materials: dict[str, int] = {"": 0}
        self._material, self._material_ids = 0, array("q")  # the latter of each polygon
        self._libraries: list[str] = []
        self._object, self._groups = "", ""
        self._objects: dict[tuple[str, str], int] = {("", ""): 0}
        self._label, self._labels = 0, array("q")  # the latter of each polygon

    def read_line(self, number: int, line: str) -> None:
        words = (line.split("#", 1)[0] if "#" in line else line).split()
        if not words or words[0] == "vn":
            return
        try:
            match words[0]:
                case "v":
                    _add_numbers(self._vertices, words, 3)
                case "vt":
                    _add_numbers(self._coordinates, words, 2)
                case "f":
                    self._read_face(words[1:])
                case "o" | "g":
                    self._begin_object(words[0], " ".join(words[1:]))
                case "usemtl":
                    name = " ".join(words[1:])
                    self._material = self._materials.setdefault(name, len(self._materials))
                case "mtllib":
                    self._libraries.append(" ".join(words[1:]))
                case _:
                    pass  # normals, smoothing, lines: no part of the surface
        except ValueError as err:
            raise UnreadableFileError(
                f"{self._name}, line {number}: {err}; the line is {line[:60]!r}"
            ) from err

    def _begin_object(self, what: str, name: str) -> None:
        if what == "o":
            self._object, self._groups = name, ""
        else:
            self._groups = name
        key = (self._object, self._groups)
        # Some programs name every face; such names choose nothing.
        self._label = self._objects.get(key, len(self._objects))
        if self._label <= MAX_OBJECTS:
            self._objects[key] = self._label

    def _read_face(self, words: list[str]) -> None:
        if len(words) < 3:
            raise ValueError(f"a face needs at least 3 corners and has {len(words)}")
        vertices, coordinates = len(self._vertices) // 3, len(self._coordinates) // 2
        for word in words:
            vertex, _, rest = word.partition("/")
            self._corners.append(_to_index(vertex, vertices, "vertices"))
            coordinate = rest.partition("/")[0]
            self._corners.append(
                _to_index(coordinate, coordinates, "texture coordinates") if coordinate else -1
            )
        self._sizes.append(len(words))
        self._material_ids.append(self._material)
        self._labels.append(self._label)

    def finish(self, path: Path, *, use_textures: bool, root: Path | None) -> RawMesh:
        notes = []
        vertices = np.array(self._vertices, dtype=np.float64).reshape(-1, 3)
        if not self._sizes:
            raise UnreadableFileError(
                f"{self._name} holds no faces, only {len(vertices)} vertices; it may be cut off"
            )
        sizes = np.array(self._sizes, dtype=np.int64)
        owner, choice = triangulate(sizes)
        if len(owner) > len(sizes):
            larger = int((sizes > 3).sum())
            notes.append(f"{larger} polygons of more than three corners were cut into triangles")
        corners = np.array(self._corners, dtype=np.int64).reshape(-1, 2)
        corners = corners[(np.cumsum(sizes) - sizes)[owner][:, None] + choice]  # (F, 3, 2)
        used = len(np.unique(corners[..., 0]))
        if used < (1 - _MAX_UNUSED) * len(vertices):
            raise UnreadableFileError(
                f"{self._name} looks cut off: {len(vertices) - used} of {len(vertices)} vertices "
                "belong to no face; if they are loose points, remove them"
            )
        uvs, texture = None, None
        missing = int((corners[..., 1] < 0).any(axis=1).sum())
        if self._coordinates and not missing:
            uvs = np.array(self._coordinates, dtype=np.float64).reshape(-1, 2)[corners[..., 1]]
        elif self._coordinates and (corners[..., 1] >= 0).any():
            notes.append(f"texture left out: {missing} faces have no texture coordinates")
        if uvs is not None and use_textures:
            texture, more = self._read_texture(path, root)
            notes += more
        objects, object_ids = self._list_objects(owner)
        return RawMesh(
            vertices=vertices,
            faces=corners[..., 0],
            uvs=uvs,
            texture=texture,
            notes=tuple(notes),
            objects=objects,
            object_ids=object_ids,
        )

    def _list_objects(
        self, owner: np.ndarray
    ) -> tuple[tuple[tuple[str, ...], ...], np.ndarray | None]:
        """Names of the objects, and the object of each triangle."""
        if len(self._objects) == 1 or len(self._objects) > MAX_OBJECTS:
            return (), None
        names = []
        for name, groups in self._objects:
            several = groups.split() if " " in groups else []
            names.append(tuple(dict.fromkeys(text for text in (name, groups, *several) if text)))
        return tuple(names), np.array(self._labels, dtype=np.int64)[owner]

    def _read_texture(self, path: Path, root: Path | None) -> tuple[ClothPicture | None, list[str]]:
        references = self._read_libraries(path, root)
        names = list(self._materials)
        faces = Counter(self._material_ids)
        used = {names[k] for k in faces} & set(references)
        counts: Counter[Path] = Counter()
        for material, count in faces.items():
            if names[material] in used:
                folder, library, reference = references[names[material]]
                picture = resolve_reference(
                    folder, reference, named_by=library, root=root, hint=TEXTURE_HINT
                )
                counts[picture] += count
        if not counts:
            return None, []
        (chosen, most), *others = counts.most_common()
        notes = []
        if others:
            share = most / len(self._sizes)
            notes.append(
                f"of {len(counts)} pictures only {chosen.name} was kept, on {share:.0%} of faces"
            )
        return load_texture(read_bytes(chosen), chosen.name), notes

    def _read_libraries(self, path: Path, root: Path | None) -> dict[str, tuple[Path, str, str]]:
        """Folder, file and reference of the colour picture of each material."""
        targets = [
            resolve_reference(path.parent, name, named_by=path.name, root=root, hint=TEXTURE_HINT)
            for name in dict.fromkeys(self._libraries)
        ]
        return {
            material: (target.parent, target.name, reference)
            for target in dict.fromkeys(targets)
            for material, reference in _read_materials(read_bytes(target)).items()
        }


def _read_materials(data: bytes) -> dict[str, str]:
    """Find the reference to the colour picture of each material of an MTL file."""
    references: dict[str, str] = {}
    name = ""
    for line in data.decode("utf-8", "replace").splitlines():
        words = line.split("#", 1)[0].split()
        if len(words) > 1 and words[0] == "newmtl":
            name = " ".join(words[1:])
        elif len(words) > 1 and words[0].lower() == "map_kd":
            # Options such as -s 1 1 1 come first.
            is_plain = not words[1].startswith("-")
            references[name] = line.split(None, 1)[1].strip() if is_plain else words[-1]
    return references


def _add_numbers(numbers: array[float], words: list[str], count: int) -> None:
    """Add the numbers that follow the first word."""
    if len(words) <= count:
        raise ValueError(f"expected {count} numbers and found {len(words) - 1}")
    numbers.extend([float(word) for word in words[1 : count + 1]])


def _to_index(word: str, count: int, what: str) -> int:
    index = int(word)
    if index == 0 or index > count or index < -count:
        raise ValueError(f"index {word[:20]} is out of range of the {count} {what} before it")
    return index - 1 if index > 0 else count + index
