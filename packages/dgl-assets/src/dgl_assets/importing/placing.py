"""Check a surface, find its category, and bring it to metres in the garment frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dgl_assets.importing.check import CleanMesh, clean_mesh
from dgl_assets.importing.directions import find_directions
from dgl_assets.importing.errors import (
    AssetImportError,
    BrokenMeshError,
    UnclearGarmentError,
)
from dgl_assets.importing.frame import Frame, find_frame, turn_outward
from dgl_assets.importing.holes import close_small_holes
from dgl_assets.importing.keypoints import Keypoints
from dgl_assets.importing.openings import (
    check_hollow,
    compute_smallest_opening,
    find_openings,
    guess_category,
    measure_trunk,
    name_openings,
)
from dgl_assets.importing.options import GarmentImportOptions
from dgl_assets.importing.raw import RawMesh
from dgl_assets.importing.scale import UNITS, find_unit
from dgl_assets.importing.topology import compute_normals

_SMALL_HOLE = 8.0  # spacings around a hole that is closed
_VERTICES = (60, 40_000)  # that a garment may need at its spacing


@dataclass(frozen=True, kw_only=True, eq=False)
class PlacedGarment:
    """A clean surface in metres and in the garment frame."""

    mesh: CleanMesh
    category: str
    frame: Frame
    unit: float
    scale: float
    openings: int
    notes: tuple[str, ...]


def place_surface(
    raw: RawMesh, name: str, options: GarmentImportOptions, keypoints: Keypoints | None = None
) -> PlacedGarment:
    """Check a surface and bring it to metres in the garment frame.

    Args:
        raw: What was read.
        name: Of the file, for messages.
        options: Options of the import.
        keypoints: Named points of the file; known names tell how it is turned.

    Raises:
        BrokenMeshError: If it is not one sheet of cloth.
        UnclearGarmentError: If something cannot be told and must be given.
    """
    units, weld = options.units, options.weld
    if weld is None:
        return _place(raw, name, options, keypoints, weld=None)
    # The sewn surface gives the unit, and the unit the distance to sew: take a unit that agrees.
    tried = [UNITS[units]] if units is not None else [*filter(None, [raw.unit]), *UNITS.values()]
    problem: AssetImportError | None = None
    for unit in dict.fromkeys(tried):
        try:
            placed = _place(raw, name, options, keypoints, weld=weld / unit)
        except (BrokenMeshError, UnclearGarmentError) as err:
            problem = problem or err
            continue
        if placed.unit == unit:
            return placed
    raise problem or UnclearGarmentError(
        f"{name}: the unit is unclear, so that `weld` cannot be measured; give `units`"
    )


def _place(
    raw: RawMesh,
    name: str,
    options: GarmentImportOptions,
    keypoints: Keypoints | None,
    *,
    weld: float | None,
) -> PlacedGarment:
    """Place a surface; `weld` is in the units of the file."""
    category, spacing = options.category, options.spacing
    scale = 1.0 if options.scale is None else options.scale
    mesh = clean_mesh(raw, name, choice=options.object, weld=weld)
    notes = list(mesh.notes)
    try:
        loops = find_openings(mesh.vertices, mesh.faces)
        if category is None:
            category, why = guess_category(mesh.vertices, loops)
            notes.append(f"category {category}, {why}")
        openings = name_openings(mesh.vertices, loops, category)
        check_hollow(mesh.vertices, mesh.faces, openings, category)
        faces, is_turned = turn_outward(mesh.vertices, mesh.faces)
        if is_turned:
            notes.append("all faces were turned over, so that normals point outward")
        frame = find_frame(
            mesh.vertices,
            faces,
            category=category,
            openings=openings,
            up=options.up,
            declared_up=raw.up,
            directions=find_directions(keypoints),
        )
        vertices = mesh.vertices @ frame.rotation.T
        longest = float(np.ptp(vertices, axis=0).max())
        unit, how = find_unit(
            longest,
            category,
            units=options.units,
            declared=raw.unit,
            trunk=measure_trunk(mesh.vertices, openings),
        )
    except UnclearGarmentError as err:
        raise UnclearGarmentError(f"{name}: {err}") from err
    notes += [*frame.notes, how]
    if scale != 1:
        notes.append(f"scaled by {scale:g}")
    factor = unit * scale
    uvs = mesh.uvs
    if is_turned and uvs is not None:
        uvs = uvs[:, [0, 2, 1]]
    if category == "Scarf" and _compute_mean_height(vertices, faces) < 0:
        faces = faces[:, [0, 2, 1]]
        uvs = None if uvs is None else uvs[:, [0, 2, 1]]
    hole = _SMALL_HOLE * spacing
    if loops:  # never an opening that was counted
        hole = min(hole, factor * compute_smallest_opening(mesh.vertices, loops[0]))
    vertices, faces, uvs, closed = close_small_holes(vertices * factor, faces, uvs, largest=hole)
    if closed:
        notes.append(f"{closed} holes of less than {hole * 1e3:.0f} mm around were closed")
    _check_size(name, vertices, faces, spacing)
    return PlacedGarment(
        mesh=CleanMesh(
            vertices=vertices, faces=faces, uvs=uvs, vertex_ids=mesh.vertex_ids, notes=()
        ),
        category=category,
        frame=frame,
        unit=unit,
        scale=factor,
        openings=len(loops),
        notes=tuple(notes),
    )


def _compute_mean_height(vertices: np.ndarray, faces: np.ndarray) -> float:
    normals, areas = compute_normals(vertices, faces)
    return float((normals[:, 2] * areas).sum())


def _check_size(name: str, vertices: np.ndarray, faces: np.ndarray, spacing: float) -> None:
    area = float(compute_normals(vertices, faces)[1].sum())
    needed = area / (np.sqrt(0.75) * spacing**2)
    if not _VERTICES[0] <= needed <= _VERTICES[1]:
        raise UnclearGarmentError(
            f"{name} would have {area:.3g} m^2 and need about {needed:,.0f} vertices at spacing "
            f"{spacing:g} m, where "
            f"{_VERTICES[0]} to {_VERTICES[1]:,} are possible; check `units` and `spacing`"
        )
