"""Mesh files of a robot, read with trimesh and kept with their colours."""

from __future__ import annotations

import importlib.util
import io
import re
from collections.abc import Iterable
from functools import lru_cache
from pathlib import Path

import numpy as np
import trimesh
from trimesh.exchange.gltf import export_glb
from trimesh.resolvers import Resolver
from trimesh.visual import ColorVisuals, TextureVisuals
from trimesh.visual.material import PBRMaterial

from dgl_assets.importing.bounds import (
    MAX_BUFFER_BYTES,
    check_count,
    check_lines,
    check_size,
)
from dgl_assets.importing.errors import AssetImportError, describe_install
from dgl_assets.importing.gltf_file import open_gltf
from dgl_assets.importing.paths import detect_kind, read_bytes, resolve_reference
from dgl_assets.importing.read_obj import check_obj
from dgl_assets.importing.read_ply import check_header
from dgl_assets.importing.read_stl import read_stl
from dgl_assets.importing.textures import open_picture
from dgl_assets.robots.errors import RobotImportError
from dgl_assets.robots.importing.raw import RawShape, Rgba

SUFFIXES = (".stl", ".obj", ".ply", ".glb", ".gltf", ".dae")
LARGEST = 5.0
"""A link longer than this is in another unit [m]."""
SMALLEST = 1e-4
"""A link shorter than this is in another unit [m]."""
_MATERIALS = (".mtl", ".bin")
_POSTSCRIPT = (b"%!PS", b"\xc5\xd0\xd3\xc6")
MAX_COLLADA_BYTES = 64 * 2**20
"""Largest COLLADA file; its parser takes many times as much memory [bytes]."""
GREY: Rgba = (0.6, 0.6, 0.6, 1.0)


class _InFolder(Resolver):
    """Gives the files that a mesh refers to, from its own folder and no other, each read once."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._files: dict[str, bytes] = {}

    def get(self, key: str) -> bytes:
        if key not in self._files:
            data = read_bytes(resolve_reference(self._path.parent, key, named_by=self._path.name))
            if key.lower().endswith(_MATERIALS):
                check_lines(data, key)
                _refuse_postscript(data, key)
            else:
                open_picture(data, key).close()
            self._files[key] = data
            check_count(
                sum(map(len, self._files.values())),
                MAX_BUFFER_BYTES,
                "bytes in other files",
                self._path.name,
            )
        return self._files[key]

    def write(self, name: str, data: bytes) -> None:
        raise NotImplementedError

    def namespaced(self, namespace: str) -> _InFolder:
        raise NotImplementedError

    def keys(self) -> list[str]:
        return []


class _Checked(_InFolder):
    """Gives the files of a glTF file that were checked, and no others."""

    def __init__(self, path: Path, files: dict[str, bytes]) -> None:
        super().__init__(path)
        self._files = files

    def get(self, key: str) -> bytes:
        return self._files[key]


def _refuse_postscript(data: bytes, name: str) -> None:
    """A picture may be named like a material, and of PostScript Pillow would start an interpreter."""
    if data[:4] in _POSTSCRIPT:
        raise RobotImportError(f"{name[:80]} is PostScript, not a material")


def load_geometry(shape: RawShape) -> list[trimesh.Trimesh]:
    """Make the triangles of a visual or collision element in the frame of its link [m].

    Raises:
        AssetImportError: If its file cannot be used.
    """
    if shape.kind == "mesh":
        assert shape.path is not None
        pieces = [piece.copy() for piece in _load_mesh(shape.path)]
        for piece in pieces:
            piece.apply_scale(np.array(shape.scale))
            if np.prod(shape.scale) < 0:
                piece.invert()
        longest = max(float(np.ptp(piece.vertices, axis=0).max()) for piece in pieces)
        if not longest >= SMALLEST:
            raise RobotImportError(
                f"{shape.path.name} is {longest:.1e} m long, at least {SMALLEST:g} m are used; is its scale in the URDF right?"
            )
        if longest > LARGEST:
            raise RobotImportError(
                f"{shape.path.name} is {longest:.1f} m long; is it in millimetres? then its scale in the URDF "
                "must be 0.001 0.001 0.001"
            )
    else:
        pieces = [_make_primitive(shape)]
    for piece in pieces:
        piece.apply_transform(shape.shape_to_link)
        if shape.rgba is not None:
            piece.visual = _paint(shape.rgba)
    return pieces


def encode_visuals(pieces: Iterable[trimesh.Trimesh]) -> bytes:
    """Write triangles with their colours as one binary glTF."""
    scene = trimesh.Scene()
    for number, piece in enumerate(pieces):
        visual = piece.visual
        if isinstance(visual, ColorVisuals):
            colour = np.asarray(visual.main_color, dtype=float) / 255 if visual.defined else GREY
            piece = trimesh.Trimesh(piece.vertices, piece.faces, process=False)
            piece.visual = _paint((colour[0], colour[1], colour[2], colour[3]))
        scene.add_geometry(piece, geom_name=f"piece_{number}", node_name=f"piece_{number}")
    return bytes(export_glb(scene, include_normals=True))


def mirror_glb(data: bytes) -> bytes:
    """Reflect a binary glTF of `encode_visuals` in x."""
    scene = trimesh.load_scene(io.BytesIO(data), file_type="glb")
    pieces = []
    for piece in scene.dump():
        assert isinstance(piece, trimesh.Trimesh)
        normals = np.array(piece.vertex_normals) * (-1, 1, 1)
        pieces.append(
            trimesh.Trimesh(
                piece.vertices * (-1, 1, 1),
                piece.faces[:, ::-1],
                vertex_normals=normals,
                visual=piece.visual,
                process=False,
            )
        )
    return encode_visuals(pieces)


def _paint(rgba: Rgba) -> TextureVisuals:
    linear = [c**2.2 for c in rgba[:3]]  # URDF colours are as they look; glTF's are linear
    return TextureVisuals(
        material=PBRMaterial(
            baseColorFactor=[*linear, rgba[3]], metallicFactor=0.1, roughnessFactor=0.55
        )
    )


def _make_primitive(shape: RawShape) -> trimesh.Trimesh:
    if shape.kind == "box":
        return trimesh.creation.box(extents=shape.size)
    if shape.kind == "sphere":
        return trimesh.creation.icosphere(subdivisions=3, radius=shape.size[0])
    radius, length = shape.size
    if shape.kind == "cylinder":
        return trimesh.creation.cylinder(radius=radius, height=length, sections=32)
    return trimesh.creation.capsule(radius=radius, height=length, count=[24, 24])


def count_vertices_and_pixels(path: Path) -> tuple[int, int]:
    """Count the vertices of a mesh file and the pixels of its pictures, each as often as a piece has it.

    Raises:
        AssetImportError: If it cannot be used.
    """
    vertices = pixels = 0
    for piece in _load_mesh(path):
        vertices += len(piece.vertices)
        material = getattr(piece.visual, "material", None)
        for name in ("baseColorTexture", "image"):
            picture = getattr(material, name, None)
            if picture is not None:
                pixels += picture.width * picture.height
                break
    return vertices, pixels


def _load_mesh(path: Path) -> tuple[trimesh.Trimesh, ...]:
    """Read a mesh file; links often share one, which is read once. The pieces must not be changed.

    Raises:
        AssetImportError: If it cannot be used.
    """
    try:
        changed = path.stat().st_mtime_ns
    except OSError as err:
        raise RobotImportError(f"{path.name} cannot be read: {err.strerror}") from err
    return _load_file(path, changed)


@lru_cache(maxsize=8)
def _load_file(path: Path, _changed: int) -> tuple[trimesh.Trimesh, ...]:
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise RobotImportError(f"{path.name}: meshes must be {', '.join(SUFFIXES)}; got {suffix!r}")
    data = read_bytes(path)
    resolver: Resolver = _InFolder(path)
    if suffix == ".dae":
        _check_collada(path, data)
    elif detect_kind(path, data) in ("glb", "gltf"):
        resolver = _Checked(path, open_gltf(path, data, use_textures=True).files)
    else:
        _check_counts(path, data)
    try:
        scene = trimesh.load_scene(
            io.BytesIO(data), file_type=suffix[1:], resolver=resolver, process=False
        )
        shown = [scene.geometry[scene.graph[node][1]] for node in scene.graph.nodes_geometry]
        check_size(
            sum(len(getattr(mesh, "vertices", ())) for mesh in shown),
            sum(len(getattr(mesh, "faces", ())) for mesh in shown),
            path.name,
        )
        loaded = [piece for piece in scene.dump() if isinstance(piece, trimesh.Trimesh)]
    except AssetImportError:
        raise
    except Exception as err:  # a foreign parser on a foreign file: it may raise anything
        raise RobotImportError(
            f"{path.name} cannot be read: {type(err).__name__}: {str(err)[:120]}"
        ) from err
    pieces = [piece for piece in loaded if len(piece.faces)]
    if not pieces:
        raise RobotImportError(f"{path.name} holds no triangles")
    for piece in pieces:
        if not np.isfinite(piece.vertices).all():
            raise RobotImportError(f"{path.name} has vertices that are not finite")
        if piece.faces.min() < 0 or piece.faces.max() >= len(piece.vertices):
            raise RobotImportError(f"{path.name} has triangles of vertices that do not exist")
        if suffix == ".dae":
            piece.apply_scale(_read_unit(data))
    return tuple(pieces)


def _check_counts(path: Path, data: bytes) -> None:
    """Refuse OBJ, PLY and STL files beyond the limits: trimesh counts only what it has built."""
    check_lines(data, path.name)
    match path.suffix.lower():
        case ".obj":
            check_obj(path.name, data)
        case ".ply":
            check_header(path.name, data)
        case _:
            read_stl(path, data)


def _check_collada(path: Path, data: bytes) -> None:
    check_count(len(data), MAX_COLLADA_BYTES, "bytes of XML", path.name)
    if importlib.util.find_spec("collada") is None:
        raise RobotImportError(
            f"{path.name} is COLLADA, which needs the package pycollada: {describe_install('collada', 'pycollada')}"
        )
    if b"<!DOCTYPE" in data or b"<!ENTITY" in data:
        raise RobotImportError(
            f"{path.name} declares a document type or entities, which are not read"
        )
    if b"<COLLADA" not in data[:4096]:
        raise RobotImportError(f"{path.name} is named .dae but is no COLLADA file")


def _read_unit(data: bytes) -> float:
    """Metres of a COLLADA file's unit; its up axis is left alone, as ROS does."""
    found = re.search(rb'<unit[^>]*\bmeter="([0-9.eE+-]+)"', data)
    unit = float(found.group(1)) if found else 1.0
    if not 1e-6 <= unit <= 1e3:
        raise RobotImportError(f"the unit of a COLLADA file must be 1e-6 to 1e3 m; got {unit:g}")
    return unit
