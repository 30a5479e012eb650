"""Garments from users' files, prepared for a task with the landmarks that its rule needs."""

import hashlib
import json
import os
import shutil
import tempfile
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree  # pyright: ignore[reportAttributeAccessIssue] - compiled

from dgl_assets import AssetError, load_garment
from dgl_assets.garments.garment import Garment
from dgl_assets.importing import GarmentImportOptions, ImportedGarment, import_garment, load_asset
from dgl_assets.importing.paths import detect_kind, read_bytes
from dgl_assets.importing.read import read_mesh
from dgl_assets.importing.source import KEYPOINTS_FILE, META_FILE, find_source
from dgl_collect.demonstration import load_demonstration
from dgl_gam import GarmentAffordanceModel
from dgl_physics import MeshError, ModelBuilder
from dgl_physics.lay_flat import lay_flat
from dgl_tasks.coverage import sample_visible_surface
from dgl_tasks.declaration import Task
from dgl_tasks.robot_files import CACHE
from dgl_tasks.soft_body import add_soft_body

__all__ = ["OwnGarment", "prepare_garment"]

FOLDER = CACHE / "garments"
"""Folder of prepared garments; they can be made again."""


@dataclass(frozen=True, kw_only=True)
class OwnGarment:
    """A garment that is ready for a task."""

    folder: Path
    """Its folder, for the option "garment"."""
    notes: tuple[str, ...]
    """Assumptions of the import, and landmarks found by the affordance model, for the user."""


def prepare_garment(source: Path, task: Task, *, folder: Path = FOLDER) -> OwnGarment:
    """Prepare a garment, from a file or an imported folder, for a task.

    A file is imported as a garment of the task's category and, except hats and gloves, laid flat in
    a short simulation. Landmarks that the task's rule needs and the garment lacks are found by the
    affordance model on the garment lying flat.

    Args:
        source: A mesh file, or the folder of an imported garment.
        task: The task.
        folder: Folder of prepared garments; an existing one is used again.

    Raises:
        ValueError: If there is nothing at `source`, or the garment is of another category or
            cannot be simulated.
        AssetError: If the file cannot be imported.
        GamError: If landmarks have to be found, and the category has no model.
    """
    if not source.exists():
        raise ValueError(
            f"garment must be a mesh file or the folder of a garment; {source} is not there"
        )
    given, notes = source, ()
    if not (source / META_FILE).is_file():
        source, notes = _import(source, task, folder)
    garment = load_asset(source)
    if garment.category != task.category:
        raise ValueError(
            f"garment must be of category {task.category}, which {task.id} is about; "
            f"{source} is of {garment.category}"
        )
    try:
        add_soft_body(
            ModelBuilder(), garment, garment.vertices, task.material, task.stiffness, task.shrinkage
        )
    except MeshError as err:
        raise ValueError(f"garment {given} cannot be simulated: {err}") from err
    missing = [name for name in task.success.landmarks if name not in garment.landmarks]
    if missing:
        notes += (f"judged by landmarks that the affordance model has found: {', '.join(missing)}",)
        source = _complete(source, garment, task, missing, folder)
    return OwnGarment(folder=source.resolve(), notes=notes)


def _import(source: Path, task: Task, folder: Path) -> tuple[Path, tuple[str, ...]]:
    """Import a file, or return an earlier import of it."""
    root = folder / _digest(source, task.category)
    made = sorted(root.glob(f"{task.category}/*/{META_FILE}"))
    if made:
        told = load_asset(made[0].parent).meta.get("assumptions", ())
        return made[0].parent, (*told, f"imported before, into {made[0].parent}")
    try:
        options = GarmentImportOptions(category=task.category)
        report = import_garment(source, out=root, options=options, lay_flat=lay_flat)
    except AssetError:
        shutil.rmtree(root, ignore_errors=True)
        raise
    return report.folder, (*report.assumptions, f"imported into {report.folder}")


def _digest(source: Path, category: str) -> str:
    """Compute a digest of a garment: its name and all files, or a file and the files it refers to.

    Raises:
        AssetError: If there is no mesh, or it cannot be read.
    """
    digest = hashlib.sha256(
        f"{category} {version('dgl-assets')} ".encode() + os.fsencode(source.name)
    )
    if source.is_dir():
        find_source(source)  # before all files of a large folder are read
        for path in sorted(path for path in source.rglob("*") if path.is_file()):
            digest.update(path.read_bytes())
        return digest.hexdigest()[:16]
    content = read_bytes(source)
    digest.update(content)
    if detect_kind(source) != "zip":
        raw = read_mesh(source)
        arrays = [raw.vertices, raw.faces, *([] if raw.uvs is None else [raw.uvs])]
        for part in [array.tobytes() for array in arrays] + [
            raw.texture.data if raw.texture else b""
        ]:
            digest.update(part)
    return digest.hexdigest()[:16]


def _complete(
    source: Path, garment: ImportedGarment, task: Task, missing: list[str], folder: Path
) -> Path:
    """Copy an imported garment, and add the landmarks that it lacks."""
    known = load_garment(load_demonstration(task.id).garment)
    found = find_landmarks(garment, known, missing)
    landmarks = {**garment.landmarks, **found}
    key = _digest(source, garment.category) + json.dumps(landmarks, sort_keys=True)
    digest = hashlib.sha256(key.encode()).hexdigest()[:16]
    target = folder / digest / garment.category / source.name
    if target.is_dir():
        return target
    target.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=target.parent, prefix=".partial-") as beside:
        copy = Path(shutil.copytree(source, Path(beside) / "copy"))
        (copy / KEYPOINTS_FILE).write_text(json.dumps(landmarks, indent=2) + "\n", encoding="utf-8")
        meta = {**garment.meta, "found_by_affordance_model": missing}
        (copy / META_FILE).write_text(json.dumps(meta, indent=2) + "\n", encoding="utf-8")
        copy.replace(target)
    return target


def find_landmarks(garment: ImportedGarment, known: Garment, names: list[str]) -> dict[str, int]:
    """Find landmarks of a known garment on another one of its category, both lying flat.

    Args:
        garment: The garment without the landmarks.
        known: A garment with the landmarks.
        names: Names of the landmarks.

    Returns:
        Vertex of each landmark.

    Raises:
        GamError: If there is no affordance model for the category.
    """
    model = GarmentAffordanceModel.load(garment.category)
    matches = model.locate(
        sample_visible_surface(known.vertices, known.faces).astype(np.float32),
        known.get_landmark_positions(tuple(names)).astype(np.float32),
        sample_visible_surface(garment.vertices, garment.faces).astype(np.float32),
        yaw=0.0,
    )
    nearest = cKDTree(garment.vertices).query(matches.points)[1]
    return {name: int(vertex) for name, vertex in zip(names, nearest, strict=True)}
