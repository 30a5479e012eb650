"""Mesh files of a robot, read with trimesh in a child process, and kept with their colours."""

from __future__ import annotations

import importlib.util
import io
import re
from collections.abc import Iterable
from functools import lru_cache
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import trimesh
from PIL import Image
from trimesh.exchange.gltf import export_glb
from trimesh.resolvers import Resolver
from trimesh.visual import ColorVisuals, TextureVisuals
from trimesh.visual.material import PBRMaterial

from dgl_assets.importing.bounds import check_size
from dgl_assets.importing.errors import UnreadableFileError, describe_install
from dgl_assets.importing.guarded import call_reader
from dgl_assets.importing.paths import check_file, detect_kind, read_bytes, resolve_reference
from dgl_assets.importing.read import read_ply, read_stl
from dgl_assets.importing.read_gltf import check_gltf
from dgl_assets.importing.textures import open_picture
from dgl_assets.robots.errors import RobotImportError
from dgl_assets.robots.importing.raw import RawShape, Rgba

SUFFIXES = (".stl", ".obj", ".ply", ".glb", ".gltf", ".dae")
LARGEST = 5.0
"""A link longer than this is in another unit [m]."""
SMALLEST = 1e-4
"""A link shorter than this is in another unit [m]."""
GREY: Rgba = (0.6, 0.6, 0.6, 1.0)
_FACTORS = ("baseColorFactor", "emissiveFactor", "metallicFactor", "roughnessFactor")
_FLAGS = ("alphaMode", "alphaCutoff", "doubleSided")
_PICTURES = (
    "baseColorTexture", "emissiveTexture", "metallicRoughnessTexture", "normalTexture",
    "occlusionTexture",
)  # fmt: skip


class _InFolder(Resolver):
    """Gives the files that a mesh refers to, from its own folder and no other."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def get(self, key: str) -> bytes:
        return read_bytes(resolve_reference(self._path.parent, key, named_by=self._path.name))

    def write(self, name: str, data: bytes) -> None:
        raise NotImplementedError

    def namespaced(self, namespace: str) -> _InFolder:
        raise NotImplementedError

    def keys(self) -> list[str]:
        return []


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
                f"{shape.path.name} is {longest:.1e} m long, at least {SMALLEST:g} m are used; is "
                "its scale in the URDF right?"
            )
        if longest > LARGEST:
            raise RobotImportError(
                f"{shape.path.name} is {longest:.1f} m long; is it in millimetres? then its scale "
                "in the URDF "
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
    """Count the vertices of a mesh file and the pixels of the pictures of all its pieces.

    Raises:
        AssetImportError: If it cannot be used.
    """
    pieces = _load_mesh(path)
    pictures = [
        getattr(piece.visual.material, "baseColorTexture", None)
        for piece in pieces
        if isinstance(piece.visual, TextureVisuals)
    ]
    pixels = sum(picture.width * picture.height for picture in pictures if picture is not None)
    return sum(len(piece.vertices) for piece in pieces), pixels


def _load_mesh(path: Path) -> tuple[trimesh.Trimesh, ...]:
    """Read a mesh file; links often share one, which is read once. The pieces must not be changed.

    Raises:
        AssetImportError: If it cannot be used.
    """
    check_file(path)
    return _load_file(path, path.stat().st_mtime_ns)


@lru_cache(maxsize=8)
def _load_file(path: Path, _changed: int) -> tuple[trimesh.Trimesh, ...]:
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise RobotImportError(f"{path.name}: meshes must be {', '.join(SUFFIXES)}; got {suffix!r}")
    if suffix == ".dae" and importlib.util.find_spec("collada") is None:
        raise RobotImportError(
            f"{path.name} is COLLADA, which needs the package pycollada: "
            + describe_install("collada", "pycollada")
        )
    return tuple(map(_unpack_piece, call_reader(read_pieces, str(path.absolute()), file=path.name)))


def read_pieces(file: str) -> list[dict[str, Any]]:
    """Read the pieces of a mesh file; `load_geometry` calls this in the child process.

    Returns:
        Plain values and arrays of each piece, placed by the file's nodes.

    Raises:
        AssetImportError: If it cannot be used.
    """
    path, unit, failures = Path(file), 1.0, []
    data, suffix = read_bytes(path), path.suffix.lower()
    if suffix == ".dae":
        unit = _read_unit(path.name, data)
    else:
        match detect_kind(path):  # what trimesh would read in part
            case "glb" | "gltf":
                check_gltf(path)
            case "ply":
                read_ply(path)
            case "stl":
                read_stl(path)
            case _:
                pass

    def open_checked(stream: Any, *_: Any, **__: Any) -> Image.Image:
        try:
            return open_picture(stream.read(), f"of {path.name}")
        except UnreadableFileError as err:
            failures.append(err)
            raise

    with patch.object(Image, "open", open_checked):
        scene = trimesh.load_scene(
            io.BytesIO(data), file_type=suffix[1:], resolver=_InFolder(path), process=False
        )
        shown = [scene.geometry[scene.graph[node][1]] for node in scene.graph.nodes_geometry]
        check_size(
            sum(len(getattr(mesh, "vertices", ())) for mesh in shown),
            sum(len(getattr(mesh, "faces", ())) for mesh in shown),
            f"{path.name}, each mesh as often as it is shown,",
        )
        loaded = [piece for piece in scene.dump() if isinstance(piece, trimesh.Trimesh)]
    if failures and suffix in (".glb", ".gltf"):  # elsewhere a mesh is used without its picture
        raise failures[0]
    pieces = [piece for piece in loaded if len(piece.faces)]
    if not pieces:
        raise RobotImportError(f"{path.name} holds no triangles")
    for piece in pieces:
        if not np.isfinite(piece.vertices).all():
            raise RobotImportError(f"{path.name} has vertices that are not finite")
        if piece.faces.min() < 0 or piece.faces.max() >= len(piece.vertices):
            raise RobotImportError(f"{path.name} has triangles of vertices that do not exist")
        if unit != 1.0:
            piece.apply_scale(unit)
    return [_pack_piece(piece) for piece in pieces]


def _pack_piece(piece: trimesh.Trimesh) -> dict[str, Any]:
    """Turn a piece into plain values; its material into that of glTF, with pictures as PNG."""
    has_normals = "vertex_normals" in piece._cache  # noqa: SLF001, elsewhere they are computed
    plain: dict[str, Any] = {
        "vertices": np.asarray(piece.vertices),
        "faces": np.asarray(piece.faces),
        "normals": np.asarray(piece.vertex_normals) if has_normals else None,
    }
    visual = piece.visual
    if isinstance(visual, ColorVisuals):
        return {**plain, "colour": visual.main_color.tolist() if visual.defined else None}
    assert isinstance(visual, TextureVisuals)
    material: Any = visual.material
    if not isinstance(material, PBRMaterial):
        material = material.to_pbr()
    values = {key: getattr(material, key, None) for key in (*_FACTORS, *_FLAGS)}
    for key in _FACTORS:
        if values[key] is not None:
            values[key] = np.asarray(values[key]).tolist()
    for key in _PICTURES:
        picture = getattr(material, key, None)
        if picture is not None:
            stream = io.BytesIO()
            picture.save(stream, format="PNG", compress_level=1)
            values[key] = stream.getvalue()
    return {**plain, "uv": visual.uv, "material": values}


def _unpack_piece(plain: dict[str, Any]) -> trimesh.Trimesh:
    """Make a piece of what `_pack_piece` gave."""
    vertices, material = plain["vertices"], plain.get("material")
    if material is None:
        colour = plain["colour"]
        colours = None if colour is None else np.tile(np.uint8(colour), (len(vertices), 1))
        visual = ColorVisuals(vertex_colors=colours)
    else:
        values = {key: value for key, value in material.items() if value is not None}
        for key in values.keys() & set(_PICTURES):
            values[key] = Image.open(io.BytesIO(values[key]), formats=["PNG"])
        visual = TextureVisuals(uv=plain["uv"], material=PBRMaterial(**values))
    return trimesh.Trimesh(
        vertices, plain["faces"], vertex_normals=plain["normals"], visual=visual, process=False
    )


def _read_unit(name: str, data: bytes) -> float:
    """Metres of a COLLADA file's unit; its up axis is left alone, as ROS does."""
    if b"<!DOCTYPE" in data or b"<!ENTITY" in data:
        raise RobotImportError(f"{name} declares a document type or entities, which are not read")
    if b"<COLLADA" not in data[:4096]:
        raise RobotImportError(f"{name} is named .dae but is no COLLADA file")
    found = re.search(rb'<unit[^>]*\bmeter="([0-9.eE+-]+)"', data)
    unit = float(found.group(1)) if found else 1.0
    if not 1e-6 <= unit <= 1e3:
        raise RobotImportError(f"the unit of a COLLADA file must be 1e-6 to 1e3 m; got {unit:g}")
    return unit
