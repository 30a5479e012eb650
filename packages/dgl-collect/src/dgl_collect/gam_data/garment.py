"""Training data of one garment: states, views and file."""

import importlib.metadata
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from dgl_assets import AssetError, Garment, MeshingError, load_garment
from dgl_collect.gam_data.states import HANGING, make_rng, make_states
from dgl_collect.gam_data.views import TOLERANCE, View, make_direction, see_surface
from dgl_gam.data import write_garment
from dgl_gam.errors import DataError
from dgl_physics import PhysicsError

__all__ = [
    "FILE",
    "SPACING",
    "Entry",
    "GarmentMaker",
    "Made",
    "find_path",
    "get_versions",
    "make_garment_data",
]

SPACING = 0.021
"""Edge length of cloth [m]: a visible point is up to 13 mm, 1 % of a garment, from its vertex. Hats
and gloves are finer."""
_OTHER_SPACINGS = (0.022, 0.020)
"""Edge lengths for outlines that cannot be filled, one garment in several hundred [m]."""
_SHELLS = ("Baseball_Cap", "Bowl_Hat", "Glove")
FILE = "garment.safetensors"
"""Name of a garment's file in the folder of its job."""
Split = Literal["train", "test"]
_PACKAGES = ("dgl-collect", "dgl-assets", "dgl-physics")


@dataclass(frozen=True, kw_only=True)
class Made:
    """Outcome of one garment."""

    id: str
    """Id in the catalogue."""
    error: str = ""
    """Reason for a missing file; empty if there is one."""
    note: str = ""
    """Note of something unusual, such as another edge length; empty if nothing is."""
    seconds: float = 0.0
    """CPU time [s]."""
    bytes: int = 0
    """Size of its file."""


def get_versions() -> dict[str, str]:
    """Get the versions of the packages that decide the content of a file."""
    return {name: importlib.metadata.version(name) for name in _PACKAGES}


def find_path(folder: Path, garment_id: str) -> Path:
    """Get the path of a garment's file in a data set."""
    return folder / f"{garment_id}.safetensors"


@dataclass(frozen=True, kw_only=True)
class Entry:
    """A garment of a data set."""

    id: str
    """Id in the catalogue."""
    split: Split
    """Split of the garment."""
    is_flat: bool = False
    """Make only the flat state, which needs no simulation."""


class GarmentMaker:
    """Makes garments' files as jobs of a worker; see `dgl_collect.workers.JobRunner`."""

    def __init__(self, *, seed: int) -> None:
        """Keep the seed of the data set."""
        self._seed = seed

    def run(self, request: Entry, out_dir: Path) -> Made:
        """Make one garment's file, `FILE`."""
        return make_garment_data(request, seed=self._seed, path=out_dir / FILE)

    def close(self) -> None:
        """Do nothing."""


def make_garment_data(entry: Entry, *, seed: int, path: Path) -> Made:
    """Make a garment's file, whole or not at all.

    Args:
        entry: The garment.
        seed: Seed of all draws, together with the garment's id.
        path: Path of the file.

    Returns:
        The outcome; it holds the reason if the garment cannot be built, simulated or seen.
    """
    begin = time.process_time()
    try:
        garment, note = _load(entry.id)
        states = make_states(garment, seed, is_flat=entry.is_flat)
        views = {name: _see(garment, name, states[name], seed) for name in states}
        _write(path, garment, entry.split, seed, states, views)
    except (PhysicsError, AssetError, DataError, ValueError) as err:
        reason = str(err) or type(err).__name__
        return Made(id=entry.id, error=reason, seconds=time.process_time() - begin)
    seconds = time.process_time() - begin
    return Made(id=entry.id, note=note, seconds=seconds, bytes=path.stat().st_size)


def _load(garment_id: str) -> tuple[Garment, str]:
    """Build a garment, at another edge length if necessary; the second value is a note on it."""
    if garment_id.partition("/")[0] in _SHELLS:
        return load_garment(garment_id), ""
    try:
        return load_garment(garment_id, spacing=SPACING), ""
    except MeshingError as err:
        for spacing in _OTHER_SPACINGS:
            try:
                garment = load_garment(garment_id, spacing=spacing)
            except MeshingError:
                continue
            return garment, f"edges of {spacing * 1e3:g} mm: {err}"
        raise


def _see(garment: Garment, name: str, positions: np.ndarray, seed: int) -> list[View]:
    """Make the views of a state, with the rounded positions that are kept."""
    rng = make_rng(seed, garment.name, f"views of {name}")
    kept = positions.astype(np.float16).astype(np.float64)
    is_one_layer = len(np.unique(garment.canonical[:, 2])) == 1
    return [
        see_surface(
            kept, garment.faces, direction, rng, tolerance=0.0 if is_one_layer else TOLERANCE
        )
        for direction in _choose_directions(name, rng)
    ]


def _choose_directions(name: str, rng: np.random.Generator) -> list[np.ndarray]:
    """Choose camera directions: from above for lying states, from the front for hanging ones."""
    if name in HANGING:
        front = make_direction(0.0, np.radians(rng.uniform(0.0, 15.0)))
        sides = [(rng.uniform(20.0, 70.0), 1), (rng.uniform(20.0, 70.0), -1)]
        return [
            front,
            *(
                make_direction(side * np.radians(a), np.radians(rng.uniform(-10.0, 45.0)))
                for a, side in sides
            ),
        ]
    tilted = [
        make_direction(rng.uniform(-np.pi, np.pi), np.radians(90.0 - rng.uniform(10.0, 45.0)))
        for _ in range(2 if name == "flat" else 1)
    ]
    return [np.array([0.0, 0.0, 1.0]), *tilted]


def _write(
    path: Path,
    garment: Garment,
    split: str,
    seed: int,
    states: dict[str, np.ndarray],
    views: dict[str, list[View]],
) -> None:
    seen = [(number, v) for number, name in enumerate(states) for v in views[name]]
    write_garment(
        path,
        category=garment.category,
        garment_id=garment.name,
        split=split,
        seed=seed,
        state_names=list(states),
        landmark_names=list(garment.landmarks),
        view_directions=np.stack([view.direction for _, view in seen]),
        generator_versions=get_versions(),
        canonical=garment.canonical,
        states=np.stack(list(states.values())).astype(np.float16),
        faces=garment.faces,
        landmarks=np.array(list(garment.landmarks.values())),
        view_points=np.stack([view.points for _, view in seen]),
        view_vertices=np.stack([view.vertices for _, view in seen]),
        view_state=np.array([number for number, _ in seen]),
    )
