"""Make an asset of a mesh file: read, check, scale, turn, remesh, lay flat, and write."""

from __future__ import annotations

import hashlib
import logging
import tempfile
import unicodedata
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from dgl_assets.importing import clothesnet
from dgl_assets.importing.archive import unpack
from dgl_assets.importing.asset_folder import write_asset
from dgl_assets.importing.categories import CATEGORIES
from dgl_assets.importing.errors import BrokenMeshError, UnreadableFileError, make_printable
from dgl_assets.importing.keypoints import Keypoints, check_on_surface, read_keypoints
from dgl_assets.importing.options import GarmentImportOptions
from dgl_assets.importing.paths import detect_kind
from dgl_assets.importing.placing import PlacedGarment, place_surface
from dgl_assets.importing.raw import RawMesh
from dgl_assets.importing.read import read_mesh
from dgl_assets.importing.remesh import Remeshed, remesh_surface
from dgl_assets.importing.report import ImportReport, measure_evenness
from dgl_assets.importing.source import Source, find_source, has_mesh, list_archives
from dgl_assets.importing.staging import check_target, stage_folder
from dgl_assets.importing.surface import SurfaceIndex
from dgl_assets.importing.topology import compute_normals, compute_vertex_normals
from dgl_assets.importing.transfer import MAX_PATCHES, label_patches, transfer_uvs

logger = logging.getLogger(__name__)

LayFlat = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]
"""Simulation that lays a garment flat.

It takes positions [m], (V, 3), faces, (F, 3), and unstrained positions [m], (V, 3), and returns
positions [m], (V, 3).
"""

NO_LICENCE = "not stated: do not redistribute"
_SAID = ("category", "units", "up", "source", "licence")  # in meta.json
_LEAST_EVEN = 0.95  # share of edges and angles below which the mesh is refused
_THICK = 0.10  # a garment that is thicker does not lie [m]
_REACH = 1.2  # width that both robots reach [m]
_LONGEST_NAME = 120  # bytes
_STRETCH = 0.05  # mean strain that laying flat may leave


def import_garment(
    path: str | Path,
    *,
    out: str | Path,
    options: GarmentImportOptions | None = None,
    lay_flat: LayFlat | None = None,
) -> ImportReport:
    """Import one garment.

    Args:
        path: A mesh file (OBJ, PLY, STL, GLB, glTF, USD), a folder with one at any depth and
            perhaps keypoints.json and meta.json, a model folder of ClothesNet, or a zip archive of
            one of these.
        out: Root of assets. The asset is written to `<out>/<category>/<name>`, whole or not at all.
        options: What is known or wanted; by default all is found out.
        lay_flat: Simulation that lays it flat; none by default. Hats and gloves keep their shape.

    Returns:
        The asset's folder, facts and assumptions.

    Raises:
        ValueError: If the name holds neither letters nor digits.
        AssetImportError: If it cannot be imported: `UnreadableFileError`, `UnsafePathError`,
            `BrokenMeshError` or `UnclearGarmentError`, each with the place and the remedy. Nothing
            is left in `out` then.

    Limitations:
        Layers that pass through each other are kept. Of a garment modelled with a thickness the
        outer surface is kept; parts that are sewn onto the cloth (pockets) are left out.
    """
    options = options or GarmentImportOptions()
    path, out = Path(path), Path(out)
    with tempfile.TemporaryDirectory(prefix="dgl-import-") as folder:
        found = find_source(_unpack(path, Path(folder)), mesh=options.mesh)
        asset_name = make_asset_name(options.name or (path.stem if path.is_file() else found.name))
        raw = read_mesh(found.mesh, use_textures=options.textures, root=found.root)
        keypoints = options.keypoints or found.keypoints
        points = None if keypoints is None else read_keypoints(keypoints, raw.vertices)
        options = _complete(options, found, path)
        placed = place_surface(raw, found.mesh.name, options, points)
        target = out / placed.category / asset_name
        check_target(target, overwrite=options.overwrite)
        return _finish(raw, placed, points, target, options, found, lay_flat)


def _complete(options: GarmentImportOptions, found: Source, path: Path) -> GarmentImportOptions:
    """Take over what the source says and the options do not."""
    said: dict[str, Any] = {"source": make_printable(path.name), "licence": NO_LICENCE}
    if found.clothesnet is not None:
        said = {
            "source": clothesnet.SOURCE,
            "licence": clothesnet.LICENCE,
            "scale": clothesnet.SCALE,
            "category": found.clothesnet.category,
        }
    said |= {key: make_printable(found.meta[key]) for key in _SAID if found.meta.get(key)}
    return replace(options, **{k: value for k, value in said.items() if not getattr(options, k)})


def _unpack(path: Path, folder: Path) -> Path:
    """Give the path itself, or the folder into which an archive was unpacked."""
    if not _is_archive(path):
        return path
    inside = folder / (make_asset_name(path.stem))
    inside.mkdir()
    unpack(path, inside)
    # Download sites pack the archive that the artist sent into one of their own.
    archives = list_archives(inside)
    if len(archives) == 1 and not has_mesh(inside):
        packed = archives[0].with_suffix("")
        if packed.exists():
            raise UnreadableFileError(
                f"{path.name} holds {packed.name[:80]!r} twice; unpack it first"
            )
        packed.mkdir()
        unpack(archives[0], packed)
    return inside


def _is_archive(path: Path) -> bool:
    try:
        is_file = path.is_file()
    except OSError:
        return False  # what is wrong is said where it is read
    return is_file and detect_kind(path) == "zip"


def make_asset_name(text: str) -> str:
    """Make the name of an asset, which names its folder, of any text.

    Letters, marks and digits of any alphabet are kept, and "-" and "_"; all else becomes "_".
    A long name is cut, with a hash of the whole at its end.

    Raises:
        ValueError: If the text holds neither letters nor digits.
    """
    whole = unicodedata.normalize("NFC", text)
    kept = (c if c in "-_" or unicodedata.category(c)[0] in "LMN" else " " for c in whole)
    name = "_".join("".join(kept).split()).strip("_")
    if not any(unicodedata.category(c)[0] in "LN" for c in name):
        raise ValueError(f"name must hold letters or digits; got {text!r}")
    if len(name.encode()) > _LONGEST_NAME:
        start = name.encode()[: _LONGEST_NAME - 9].decode(errors="ignore")
        name = f"{start}-{hashlib.sha256(whole.encode(errors='replace')).hexdigest()[:8]}"
    return name


def _finish(
    raw: RawMesh,
    placed: PlacedGarment,
    points: Keypoints | None,
    target: Path,
    options: GarmentImportOptions,
    found: Source,
    lay_flat: LayFlat | None,
) -> ImportReport:
    """Remesh, carry over what is on the surface, lay flat, and write."""
    mesh, notes, spacing = placed.mesh, list(placed.notes), options.spacing
    surface = SurfaceIndex(mesh.vertices, mesh.faces, spacing=spacing / 2)
    pins, pin_normals = _place_points(placed, points, surface, target.name)
    remeshed = remesh_surface(
        mesh.vertices, mesh.faces, spacing=spacing, pins=pins, pin_normals=pin_normals
    )
    even_edges, even_angles = measure_evenness(remeshed.vertices, remeshed.faces, spacing=spacing)
    if min(even_edges, even_angles) < _LEAST_EVEN:
        raise BrokenMeshError(
            f"{target.name}: the surface cannot be meshed evenly at spacing {spacing:g} m: "
            f"{even_edges:.1%} of edges "
            f"and {even_angles:.1%} of angles are even; it is crumpled or has folds closer than "
            "`spacing`"
        )
    uvs, texture = None, raw.texture
    if mesh.uvs is not None:
        patches, _ = label_patches(mesh.faces, mesh.uvs)
        if patches <= MAX_PATCHES:
            uvs = transfer_uvs(surface, mesh.uvs, remeshed.vertices, remeshed.faces)
        else:
            texture = None
            notes.append(
                f"texture left out: it is cut into {patches} patches, at most {MAX_PATCHES} are "
                "kept"
            )
    rest = _centre(remeshed.vertices)
    laid = None
    is_shell = CATEGORIES[placed.category].wall_thickness is not None
    if lay_flat is not None and is_shell:
        notes.append(f"not laid flat: a {placed.category} keeps its shape")
    elif lay_flat is not None:
        laid = _lay_flat(lay_flat, rest, remeshed)
        notes.append("laid flat by simulation")
    vertices = rest if laid is None else laid
    notes += _judge(vertices, placed.category)
    landmarks = (
        {} if points is None else dict(zip(points.names, remeshed.pins.tolist(), strict=True))
    )
    size = np.ptp(vertices, axis=0)
    report = ImportReport(
        folder=target,
        name=target.name,
        category=placed.category,
        subtype=make_printable(found.subtype),
        source=options.source or "",
        source_id=make_printable(found.meta.get("source_id") or found.mesh.stem),
        licence=options.licence or "",
        unit=placed.unit,
        scale=placed.scale,
        up=placed.frame.up,
        vertex_count=len(vertices),
        face_count=len(remeshed.faces),
        area=float(compute_normals(rest, remeshed.faces)[1].sum()),
        extent=(float(size[0]), float(size[1]), float(size[2])),
        openings=placed.openings,
        even_edges=even_edges,
        even_angles=even_angles,
        landmarks=tuple(landmarks),
        has_texture=texture is not None and uvs is not None,
        is_laid_flat=laid is not None,
        assumptions=tuple(notes),
    )
    meta = {key: value for key, value in report.to_dict().items() if key != "folder"}
    meta["wall_thickness"] = CATEGORIES[placed.category].wall_thickness
    meta |= {"rotation": placed.frame.rotation.tolist(), "spacing": spacing}
    with stage_folder(target, overwrite=options.overwrite) as folder:
        write_asset(
            folder,
            vertices=vertices,
            faces=remeshed.faces,
            rest_vertices=None if laid is None else rest,
            uvs=uvs,
            texture=texture,
            landmarks=landmarks,
            meta=meta,
        )
    logger.info("imported %s: %d vertices", target, len(vertices))
    return report


def _place_points(
    placed: PlacedGarment, points: Keypoints | None, surface: SurfaceIndex, name: str
) -> tuple[np.ndarray | None, np.ndarray | None]:
    """Place landmarks in the garment frame [m], and find the normals there."""
    if points is None or not len(points.names):
        return None, None
    positions = points.positions @ placed.frame.rotation.T * placed.scale
    faces, weights = surface.locate(positions)
    on_surface = surface.evaluate(faces, weights)
    distances = np.linalg.norm(on_surface - positions, axis=1) / placed.scale
    check_on_surface(points, surface.vertices / placed.scale, distances, name)
    normals = surface.normals[faces]
    # A vertex of the file says on which layer it is; a position does not.
    ids = np.where(points.vertex_ids >= 0, placed.mesh.vertex_ids[points.vertex_ids], -1)
    known = ids >= 0
    vertex_normals = compute_vertex_normals(surface.vertices, surface.faces)
    normals[known] = vertex_normals[ids[known]]
    return on_surface, normals


def _lay_flat(lay_flat: LayFlat, rest: np.ndarray, mesh: Remeshed) -> np.ndarray:
    positions = np.asarray(lay_flat(rest.copy(), mesh.faces.copy(), rest.copy()), dtype=np.float64)
    if positions.shape != rest.shape or not np.isfinite(positions).all():
        raise ValueError(
            f"lay_flat must return finite positions of shape {rest.shape}; got {positions.shape}"
        )
    sides = [
        np.linalg.norm(p[mesh.faces] - p[np.roll(mesh.faces, 1, axis=1)], axis=2)
        for p in (positions, rest)
    ]
    strain = float(np.abs(sides[0] / sides[1] - 1).mean())
    if strain > _STRETCH:
        raise BrokenMeshError(
            f"laying it flat left a mean strain of {strain:.1%}, at most {_STRETCH:.0%} is kept; "
            "import it as it is, without `lay_flat`"
        )
    return _centre(_face_as(positions, rest))


def _face_as(positions: np.ndarray, rest: np.ndarray) -> np.ndarray:
    """Turn a garment about the vertical, as far as it turned while it fell."""
    before, after = (p[:, :2] - p[:, :2].mean(axis=0) for p in (rest, positions))
    cosine, sine = (
        (before * after).sum(),
        (after[:, 0] * before[:, 1] - after[:, 1] * before[:, 0]).sum(),
    )
    angle = np.arctan2(sine, cosine)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    return np.column_stack([positions[:, :2] @ turn.T, positions[:, 2]])


def _centre(vertices: np.ndarray) -> np.ndarray:
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    return vertices - (low + high) / 2


def _judge(vertices: np.ndarray, category: str) -> list[str]:
    """Note limits of use: a garment that does not lie, or is too wide for the robots."""
    extent = np.ptp(vertices, axis=0)
    notes = []
    if len(CATEGORIES[category].openings) > 1 and extent[2] > _THICK:
        notes.append(f"it is {extent[2]:.2f} m thick and does not lie yet; lay it flat: `lay_flat`")
    if extent[0] > _REACH and category != "Scarf":
        notes.append(
            f"it is {extent[0]:.2f} m wide, more than both robots reach ({_REACH} m); scale it "
            "down: `scale`"
        )
    return notes
