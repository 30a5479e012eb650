"""Clouds of garments from files, imported assets or the catalogue."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from dexgarmentlab.gam.axes import Up, describe_axes, turn_up

if TYPE_CHECKING:
    from dgl_assets import Garment
    from dgl_assets.importing import ImportedGarment

__all__ = ["Cloud", "load_cloud"]

MAX_POINTS = 1_000_000
"""Most points of a cloud; the networks see 2,048 of them."""
_POINT_FILES = (".npy", ".ply", ".safetensors")
_MESH_FILES = (".obj", ".stl", ".glb", ".gltf", ".usd", ".usda", ".usdc", ".usdz")
_UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, kw_only=True)
class Cloud:
    """A cloud, with what is known about it."""

    name: str
    """File or id that it came from."""
    points: np.ndarray
    """Shape (N, 3) [m], float64."""
    category: str | None = None
    """Category of the garment, where it is known."""
    landmarks: dict[str, np.ndarray] | None = None
    """Positions of the landmarks [m], each of shape (3,), where they are known."""
    assumptions: tuple[str, ...] = ()
    """Findings and assumptions about a file: its unit, up axis and category."""


def load_cloud(
    what: str, *, seed: int = 0, up: Up | None = None, category: str | None = None
) -> Cloud:
    """Load the cloud that a word on the command line means.

    Args:
        what: A file .npy or .ply (points), or .safetensors (a garment's training data, lying flat,
            or a tensor named "points"); a mesh file (.obj, .ply with faces, .stl, .glb, .gltf,
            .usd), or the folder of an imported asset, or an id of the catalogue, such as
            Trousers/000003: these are seen from above.
        seed: Of the points that are drawn from a garment.
        up: Up axis of a file. Without it, z of points; of a mesh it is found from its openings.
        category: Category of a mesh file; found from its openings when None.

    Raises:
        ValueError: If it is neither, or the file holds no cloud.
        FileNotFoundError: If the file does not exist.
        AssetImportError: If a mesh is none of a garment.
    """
    path = Path(what)
    suffix = path.suffix.lower()
    if suffix in (*_POINT_FILES, *_MESH_FILES):
        if not path.is_file():
            raise FileNotFoundError(f"{what} does not exist")
        if suffix in _MESH_FILES:
            return _import_mesh(path, seed=seed, up=up, category=category)
        if suffix == ".npy":
            return _turn(path, _read_npy(path), up)
        if suffix == ".ply":
            points = _read_ply(path)
            if points is None:
                return _import_mesh(path, seed=seed, up=up, category=category)
            return _turn(path, points, up)
        return _read_safetensors(path, up)
    if (path / "meta.json").is_file():
        from dgl_assets.importing import load_asset

        return _see(path.name, load_asset(path), seed)
    if "/" not in what:
        raise ValueError(
            f"a cloud must be a file {', '.join((*_POINT_FILES, *_MESH_FILES))}, the folder of "
            "an imported asset, "
            f"or an id such as Trousers/000003; got {what!r}"
        )
    from dgl_assets import load_garment

    return _see(what, load_garment(what), seed)


def _see(
    name: str, garment: Garment | ImportedGarment, seed: int, assumptions: tuple[str, ...] = ()
) -> Cloud:
    """See a garment from above."""
    from dgl_collect.gam_data import see_surface

    vertices = garment.vertices.astype(np.float64)
    landmarks: Mapping[str, int] = garment.landmarks
    return Cloud(
        name=name,
        points=see_surface(vertices, garment.faces, _UP, np.random.default_rng(seed)).points,
        category=garment.category,
        landmarks={name: vertices[vertex] for name, vertex in landmarks.items()},
        assumptions=assumptions,
    )


def _import_mesh(path: Path, *, seed: int, up: Up | None, category: str | None) -> Cloud:
    """Import a mesh in metres and the garment frame."""
    from dgl_assets.importing import GarmentImportOptions, import_garment, load_asset

    with tempfile.TemporaryDirectory(prefix="dgl-match-") as folder:
        options = GarmentImportOptions(category=category, up=up, textures=False)
        report = import_garment(path, out=folder, options=options)
        asset = load_asset(report.folder)
    return _see(path.name, asset, seed, report.assumptions)


def _turn(path: Path, points: np.ndarray, up: Up | None) -> Cloud:
    """Points of a file, with the axis that is up as z."""
    turned = turn_up(points, up or "z")
    return Cloud(name=path.name, points=turned, assumptions=describe_axes(turned, up))


def _read_npy(path: Path) -> np.ndarray:
    try:
        # Mapped: a file that declares more than it holds is refused before memory is taken.
        array = np.load(path, allow_pickle=False, mmap_mode="r")
    except (ValueError, EOFError) as err:
        raise ValueError(f"{path} is no array of numbers: {err}") from err
    return _check(path, array)


def _read_ply(path: Path) -> np.ndarray | None:
    """Points of a cloud; None of a mesh."""
    import trimesh

    try:
        loaded = trimesh.load(path, process=False)
    except Exception as err:  # trimesh has no exception of its own for damaged files
        raise ValueError(f"{path} cannot be read as PLY: {err}") from err
    if len(getattr(loaded, "faces", ())):
        return None
    return _check(path, getattr(loaded, "vertices", None))


def _read_safetensors(path: Path, up: Up | None) -> Cloud:
    from safetensors import SafetensorError, safe_open

    from dgl_gam.data import read_garment

    try:
        with safe_open(path, framework="np") as file:
            names = set(file.keys())
            points = file.get_tensor("points") if "points" in names else None
    except SafetensorError as err:
        raise ValueError(f"{path} cannot be read as safetensors: {err}") from err
    if points is not None:
        return _turn(path, _check(path, points), up)
    garment = read_garment(path)
    flat = garment.get_views("flat")
    view = int(flat[0]) if len(flat) else 0
    state = garment.states[garment.view_state[view]].astype(np.float64)
    return Cloud(
        name=garment.header.garment_id,
        points=garment.view_points[view].astype(np.float64),
        category=garment.header.category,
        landmarks={
            name: state[vertex]
            for name, vertex in zip(garment.header.landmark_names, garment.landmarks, strict=True)
        },
    )


def _check(path: Path, array: np.ndarray | None) -> np.ndarray:
    if array is None or array.ndim != 2 or array.shape[1] < 3 or array.dtype.kind not in "fiu":
        shape = None if array is None else (array.shape, str(array.dtype))
        raise ValueError(f"{path} must hold points of shape (N, 3) or more columns; got {shape}")
    if len(array) > MAX_POINTS:
        raise ValueError(f"{path} must hold at most {MAX_POINTS:,} points; got {len(array):,}")
    return np.asarray(array[:, :3], dtype=np.float64)
