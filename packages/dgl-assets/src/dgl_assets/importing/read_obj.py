"""Wavefront OBJ with its materials.

Read here and not by trimesh, so that vertices keep the numbers that key points refer to and errors name their line.
"""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np

from dgl_assets.importing.errors import UnreadableFileError
from dgl_assets.importing.paths import TEXTURE_HINT, read_bytes, resolve_reference
from dgl_assets.importing.raw import (
    MAX_FACES,
    MAX_VERTICES,
    RawMesh,
    Texture,
    check_size,
    triangulate,
)
from dgl_assets.importing.textures import load_texture

_MAX_UNUSED = 0.01  # of the vertices; OBJ has no other sign that its end is missing
Corner = tuple[int, int]  # vertex and texture coordinate, -1 for none


def read_obj(path: Path, data: bytes, *, use_textures: bool) -> RawMesh:
    """Read an OBJ file.

    Args:
        path: Of the file; materials and pictures are looked for beside it.
        data: The file.
        use_textures: Whether to read materials.

    Raises:
        UnreadableFileError: With the line that cannot be read.
        UnsafePathError: If a material or a picture lies outside the folder.
    """
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = data.decode("latin-1")  # comments and names in an old code page
    parser = _Parser(path.name)
    for number, line in enumerate(text.replace("\\\n", " ").splitlines(), start=1):
        parser.read_line(number, line)
    return parser.finish(path, use_textures=use_textures)


class _Parser:
    def __init__(self, name: str) -> None:
        self._name = name
        self._vertices: list[list[float]] = []
        self._coordinates: list[list[float]] = []
        self._polygons: list[tuple[Corner, ...]] = []
        self._materials: list[str] = []  # of each polygon
        self._libraries: list[str] = []
        self._material = ""

    def read_line(self, number: int, line: str) -> None:
        words = line.split("#", 1)[0].split()
        if not words:
            return
        try:
            match words[0]:
                case "v":
                    self._vertices.append(_read_numbers(words[1:4], 3))
                    if len(self._vertices) > MAX_VERTICES:
                        check_size(len(self._vertices), 0, self._name)
                case "vt":
                    self._coordinates.append(_read_numbers(words[1:3], 2))
                case "f":
                    self._read_face(words[1:])
                case "usemtl":
                    self._material = " ".join(words[1:])
                case "mtllib":
                    self._libraries.append(" ".join(words[1:]))
                case _:
                    pass  # groups, normals, smoothing, lines: no part of the surface
        except ValueError as err:
            raise UnreadableFileError(
                f"{self._name}, line {number}: {err}; the line is {line[:60]!r}"
            ) from err

    def _read_face(self, words: list[str]) -> None:
        if len(words) < 3:
            raise ValueError(f"a face needs at least 3 corners and has {len(words)}")
        self._polygons.append(tuple(self._read_corner(word) for word in words))
        self._materials.append(self._material)
        if len(self._polygons) > MAX_FACES:
            check_size(0, len(self._polygons), self._name)

    def _read_corner(self, word: str) -> Corner:
        parts = word.split("/")
        vertex = _to_index(parts[0], len(self._vertices), "vertices")
        if len(parts) > 1 and parts[1]:
            return vertex, _to_index(parts[1], len(self._coordinates), "texture coordinates")
        return vertex, -1

    def finish(self, path: Path, *, use_textures: bool) -> RawMesh:
        notes = []
        if not self._polygons:
            raise UnreadableFileError(
                f"{self._name} holds no faces, only {len(self._vertices)} vertices; it may be cut off"
            )
        owner, choice = triangulate(self._polygons)
        if len(owner) > len(self._polygons):
            larger = sum(len(polygon) > 3 for polygon in self._polygons)
            notes.append(f"{larger} polygons of more than three corners were cut into triangles")
        corners = np.array(
            [
                [self._polygons[o][k] for k in ks]
                for o, ks in zip(owner.tolist(), choice.tolist(), strict=True)
            ],
            dtype=np.int64,
        ).reshape(-1, 3, 2)
        used = len(np.unique(corners[..., 0]))
        if used < (1 - _MAX_UNUSED) * len(self._vertices):
            raise UnreadableFileError(
                f"{self._name} looks cut off: {len(self._vertices) - used} of {len(self._vertices)} vertices "
                "belong to no face; if they are loose points, remove them"
            )
        uvs, texture = None, None
        if self._coordinates and (corners[..., 1] >= 0).all():
            uvs = np.array(self._coordinates, dtype=np.float64)[corners[..., 1]]
        elif self._coordinates and (corners[..., 1] >= 0).any():
            missing = int((corners[..., 1] < 0).any(axis=1).sum())
            notes.append(f"texture left out: {missing} faces have no texture coordinates")
        if uvs is not None and use_textures:
            texture, more = self._read_texture(path)
            notes += more
        return RawMesh(
            vertices=np.array(self._vertices, dtype=np.float64).reshape(-1, 3),
            faces=corners[..., 0],
            uvs=uvs,
            texture=texture,
            notes=tuple(notes),
        )

    def _read_texture(self, path: Path) -> tuple[Texture | None, list[str]]:
        pictures: dict[str, Path] = {}
        for library in self._libraries:
            target = resolve_reference(path.parent, library, named_by=path.name, hint=TEXTURE_HINT)
            pictures |= _read_materials(target)
        counts = Counter(pictures[name] for name in self._materials if name in pictures)
        if not counts:
            return None, []
        (chosen, faces), *others = counts.most_common()
        notes = []
        if others:
            share = faces / len(self._materials)
            notes.append(
                f"of {len(counts)} pictures only {chosen.name} was kept, on {share:.0%} of the faces"
            )
        return load_texture(read_bytes(chosen), chosen.name), notes


def _read_materials(path: Path) -> dict[str, Path]:
    """The colour picture of each material of an MTL file."""
    pictures: dict[str, Path] = {}
    name = ""
    for line in read_bytes(path).decode("utf-8", "replace").splitlines():
        words = line.split("#", 1)[0].split()
        if len(words) > 1 and words[0] == "newmtl":
            name = " ".join(words[1:])
        elif len(words) > 1 and words[0].lower() == "map_kd":
            reference = line.split(None, 1)[1].strip()
            if words[1].startswith("-"):  # options such as -s 1 1 1 come first
                reference = words[-1]
            pictures[name] = resolve_reference(
                path.parent, reference, named_by=path.name, hint=TEXTURE_HINT
            )
    return pictures


def _read_numbers(words: list[str], count: int) -> list[float]:
    if len(words) < count:
        raise ValueError(f"expected {count} numbers and found {len(words)}")
    return [float(word) for word in words]


def _to_index(word: str, count: int, what: str) -> int:
    index = int(word)
    if index == 0 or index > count or index < -count:
        raise ValueError(f"index {index} is out of range of the {count} {what} before it")
    return index - 1 if index > 0 else count + index
