"""From garments without canonical coordinates to garments with them: those of the registration."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dgl_gam.data.correspondence import find_vertices
from dgl_gam.data.folder import GarmentFolder
from dgl_gam.data.garment_file import GarmentData, write_garment
from dgl_gam.errors import DataError
from dgl_gam.skeleton.fit import find_key_points
from dgl_gam.skeleton.merger import SkeletonMerger
from dgl_gam.skeleton.register import Template, register

__all__ = ["SkeletonResult", "measure_registration", "write_registered"]


@dataclass(frozen=True, kw_only=True)
class SkeletonResult:
    """Errors of registered garments where the exact correspondence is known."""

    pairs: int
    """Pairs of garments."""
    mean_error: float
    """Mean error, as a share of the horizontal diagonal."""
    pck05: float
    """Share of the points within 5 % of the diagonal."""
    pck10: float
    """Share of the points within 10 % of the diagonal."""


def write_registered(
    network: SkeletonMerger,
    folder: GarmentFolder,
    out: Path,
    *,
    on_progress: Callable[[str], None] | None = None,
) -> list[Path]:
    """Copy a folder of garments with canonical coordinates from the registration.

    The template is the garment of the training split whose key points are nearest to the mean. A
    place's coordinates are where it is carried to on the template, from its centre, by half of its
    diagonal, and the side that the mesh faces: up is the front.

    Args:
        network: Finds key points.
        folder: Garments of one category.
        out: Folder for the files.
        on_progress: Called with each garment's id.

    Returns:
        The files.

    Raises:
        DataError: If a garment has no view lying flat, or the folder has several categories.
    """
    if len(folder.categories) != 1:
        raise DataError(f"garments of one category are registered; got {folder.categories}")
    keys = np.stack(
        [find_key_points(network, get_flat_cloud(folder.load(i))) for i in range(len(folder))]
    )[..., :2]
    number = _choose_template(folder, keys)
    cloud = get_flat_cloud(folder.load(number))[:, :2].astype(np.float64)
    template = Template(cloud=cloud, keys=keys[number])
    centre = (cloud.min(axis=0) + cloud.max(axis=0)) / 2
    paths = []
    for index in range(len(folder)):
        garment = folder.load(index)
        if on_progress is not None:
            on_progress(garment.header.garment_id)
        flat = garment.states[0].astype(np.float64)
        place = register(template, keys[index], flat[:, :2])
        canonical = np.c_[(place - centre) / (template.diagonal / 2), _find_sides(garment)]
        path = Path(out) / garment.header.path.name
        write_garment(
            path,
            category=garment.header.category,
            garment_id=garment.header.garment_id,
            split=garment.header.split,
            seed=garment.header.seed,
            state_names=garment.header.state_names,
            landmark_names=garment.header.landmark_names,
            view_directions=np.asarray(garment.header.view_directions),
            generator_versions={**garment.header.generator_versions, "canonical": "skeleton"},
            canonical=canonical,
            states=garment.states.astype(np.float16),
            faces=garment.faces,
            landmarks=garment.landmarks,
            view_points=garment.view_points,
            view_vertices=garment.view_vertices,
            view_state=garment.view_state,
        )
        paths.append(path)
    return paths


def measure_registration(
    truth: GarmentFolder, registered: GarmentFolder, *, pairs: int, seed: int
) -> SkeletonResult:
    """Compare registered with exact correspondence, on visible points of flat garments.

    Args:
        truth: Garments with exact canonical coordinates.
        registered: The same garments, registered.
        pairs: Pairs that are drawn.
        seed: Of the pairs and points.

    Raises:
        DataError: If a garment has no exact coordinates or no flat view, or the folders hold
            different garments.
    """
    names = [[h.garment_id for h in folder.headers] for folder in (truth, registered)]
    if names[0] != names[1]:
        raise DataError("both folders must hold the same garments")
    rng = np.random.default_rng(seed)
    errors = []
    for _ in range(pairs):
        a, b = (int(i) for i in rng.choice(len(truth), 2, replace=False))
        source, target = truth.load(a), truth.load(b)
        if not (source.has_canonical and target.has_canonical):
            raise DataError(
                f"{source.header.path} or {target.header.path} has no exact coordinates"
            )
        view = _get_flat_view(source)
        vertices = rng.choice(source.view_vertices[view], 60, replace=False)
        exact = find_vertices(source, vertices, target)
        seen = np.unique(target.view_vertices[_get_flat_view(target)])
        wanted = registered.load(a).canonical[vertices]
        there = registered.load(b).canonical[seen]
        found = seen[np.linalg.norm(wanted[:, None] - there[None], axis=2).argmin(axis=1)]
        flat = target.states[0][:, :2]
        distance = np.linalg.norm(flat[found] - flat[exact], axis=1) / target.diagonal
        errors.append(distance[exact >= 0])
    error = np.concatenate(errors)
    return SkeletonResult(
        pairs=pairs,
        mean_error=float(error.mean()),
        pck05=float((error <= 0.05).mean()),
        pck10=float((error <= 0.10).mean()),
    )


def get_flat_cloud(garment: GarmentData) -> np.ndarray:
    """Points of a garment's first view lying flat [m], shape (2048, 3)."""
    return garment.view_points[_get_flat_view(garment)]


def _get_flat_view(garment: GarmentData) -> int:
    views = garment.get_views("flat")
    if not len(views):
        raise DataError(f"{garment.header.path} has no view lying flat")
    return int(views[0])


def _choose_template(folder: GarmentFolder, keys: np.ndarray) -> int:
    train = [i for i, h in enumerate(folder.headers) if h.split == "train"]
    chosen = np.array(train or range(len(folder)))
    centred = keys[chosen] - keys[chosen].mean(axis=1, keepdims=True)
    return int(chosen[np.linalg.norm(centred - centred.mean(axis=0), axis=(1, 2)).argmin()])


def _find_sides(garment: GarmentData) -> np.ndarray:
    """+1 where the flat mesh faces up, -1 where it faces down, 0 where both meet, shape (V,)."""
    corners = garment.states[0][garment.faces]
    up = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2]
    sides = np.zeros((2, len(garment.states[0])), dtype=bool)
    for row, is_facing in enumerate((up > 0, up < 0)):
        sides[row, garment.faces[is_facing].ravel()] = True
    return sides[0].astype(np.float32) - sides[1].astype(np.float32)
