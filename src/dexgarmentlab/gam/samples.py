"""The clouds that come with dgl_gam: a small part of a data set, made smaller."""

from pathlib import Path

import numpy as np

from dgl_gam.data import GarmentData, GarmentFolder, write_garment
from dgl_gam.errors import DataError

__all__ = ["GARMENTS", "write_samples"]

GARMENTS = 2
"""Of each category."""
_STATES = ("flat", "dropped", "sleeve_folded", "side_folded", "leg_folded", "end_folded", "tilted")


def write_samples(data: Path, out: Path) -> list[Path]:
    """Write test garments, each with a few states and two views of each state.

    Args:
        data: Folder of training data.
        out: Folder for the files, one for each garment.

    Returns:
        The files.

    Raises:
        DataError: If a category has too few garments to test on.
    """
    folder = GarmentFolder(data, split="test")
    written = []
    for category in folder.categories:
        indices = folder.get_indices(category)
        if len(indices) < GARMENTS:
            raise DataError(
                f"{data} must have {GARMENTS} garments of {category} to test on; got {len(indices)}"
            )
        # Those with the most states; of equal ones the first.
        chosen = sorted(indices, key=lambda i: -len(folder.headers[i].state_names))[:GARMENTS]
        for garment in map(folder.load, sorted(chosen)):
            path = out / f"{garment.header.garment_id.replace('/', '_')}.safetensors"
            _write(garment, path)
            written.append(path)
    return written


def _write(garment: GarmentData, path: Path) -> None:
    header = garment.header
    states = [s for s, kind in enumerate(header.state_kinds) if kind in _STATES]
    views = [v for s in states for v in np.flatnonzero(garment.view_state == s)[:2]]
    write_garment(
        path,
        category=header.category,
        garment_id=header.garment_id,
        split=header.split,
        seed=header.seed,
        state_names=[header.state_names[s] for s in states],
        landmark_names=header.landmark_names,
        view_directions=np.array(header.view_directions)[views],
        generator_versions=header.generator_versions,
        canonical=garment.canonical,
        states=garment.states[states].astype(np.float16),
        faces=garment.faces,
        landmarks=garment.landmarks,
        view_points=garment.view_points[views],
        view_vertices=garment.view_vertices[views],
        view_state=np.array([states.index(s) for s in garment.view_state[views]]),
    )
