"""Record of one dropped garment: one line of JSON."""

import json
import time
from dataclasses import asdict, dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from dgl_assets import AssetError, Garment, load_garment
from dgl_bench.assets.drop import drop_garment
from dgl_bench.assets.measures import describe_mesh, measure_landmarks
from dgl_files.fields import STRICT, read_json
from dgl_files.whole import written_beside
from dgl_physics import PhysicsError

__all__ = [
    "EDGE_CHANGE_LIMIT",
    "POSITIONS",
    "POSITIONS_FILE",
    "STRAIN_LIMIT",
    "Attempt",
    "DropRequest",
    "Drops",
    "find_positions",
    "read_attempts",
]

STRAIN_LIMIT = 0.01
"""Mean strain of a whole garment, at most, in every frame."""
EDGE_CHANGE_LIMIT = 0.5
"""Change of length of each edge of a whole garment at the end, at most. Collars that fold and
fronts that overlap start with up to 0.1, so this tells spikes, not strain."""
POSITIONS = "final"
"""Folder, in that of a run, with where each garment came to lie."""
POSITIONS_FILE = "positions.npy"
"""Name of the same in the folder of a garment's job."""
_KEPT = 64  # garments that a worker remembers: a garment's partner is the one selected before it


@dataclass(frozen=True, kw_only=True)
class Attempt:
    """One dropped garment. Lengths [m], times [s], shares and strains as fractions."""

    __pydantic_config__ = STRICT

    id: str
    error: str = ""
    """Why it could not be built or simulated to the end; empty when it could."""
    vertices: int = 0
    edges: int = 0
    faces: int = 0
    particles: int = 0
    """Vertices, and those of a shell's inner side."""
    build_seconds: float | None = None
    """CPU time of building the garment."""
    drop_seconds: float | None = None
    """CPU time of simulating and measuring it."""
    edge_mean: float | None = None
    edge_shortest: float | None = None
    edge_longest: float | None = None
    edge_share: float | None = None
    """Share of the edges within the accepted range."""
    angle_smallest: float | None = None
    """[degrees]."""
    angle_share: float | None = None
    """Share of the triangles without a sharp angle."""
    partner: str = ""
    """The garment that its landmarks were mapped to."""
    landmark_miss: float | None = None
    """Largest distance of a mapped landmark from the partner's, in mean edge lengths of the
    partner."""
    landmark: str = ""
    """Name of that landmark."""
    strain_start: float | None = None
    """Mean strain as let go."""
    strain_worst: float | None = None
    """Mean strain in the worst frame, the start included."""
    strain_worst_frame: int | None = None
    frames_over: int | None = None
    """Frames in which the mean strain was above the limit, the start included."""
    strain_end: float | None = None
    edge_change: float | None = None
    """Largest change of length of one edge at the end."""
    speed: float | None = None
    """Root mean square speed at the end [m/s]."""
    still_seconds: float | None = None
    """Time until it rested to the end; None if it kept moving."""
    crossings_start: int | None = None
    """Edges that pierce a triangle of another place."""
    crossings_end: int | None = None

    @property
    def category(self) -> str:
        """The catalogue's category."""
        return self.id.partition("/")[0]

    @property
    def faults(self) -> tuple[str, ...]:
        """Why it is not whole; nothing when it is."""
        if self.error:
            return (self.error,)
        faults = []
        if self.strain_worst is None or not self.strain_worst <= STRAIN_LIMIT:
            faults.append(
                f"mean strain {_percent(self.strain_worst)} in frame {self.strain_worst_frame}, "
                f"{_percent(self.strain_end)} at the end"
            )
        if self.edge_change is None or not self.edge_change <= EDGE_CHANGE_LIMIT:
            faults.append(f"an edge changed by {_percent(self.edge_change)}")
        return tuple(faults)

    @property
    def is_whole(self) -> bool:
        """True if no edge, no frame and no number is out of bounds."""
        return not self.faults

    def to_line(self) -> str:
        """Give it as one line of JSON, without the line end."""
        return json.dumps(asdict(self), allow_nan=False)

    @classmethod
    def from_line(cls, line: str) -> "Attempt":
        """Read it from its line.

        Raises:
            ValueError: If the line is none; with the field and the value.
        """
        return read_json(cls, line)


@dataclass(frozen=True, kw_only=True)
class DropRequest:
    """A garment to drop."""

    id: str
    """Id of the garment."""
    partner: str
    """The garment that its landmarks are mapped to."""


@dataclass(frozen=True, kw_only=True)
class Drops:
    """Jobs that build, measure and drop garments; see `dgl_collect.workers.JobRunner`."""

    frames: int
    """Simulated time [1/60 s]."""
    height: float
    """Height that each falls from [m]."""

    def run(self, request: DropRequest, out_dir: Path) -> Attempt:
        """Drop one garment, and save where it came to lie in `POSITIONS_FILE`, whole or not."""
        try:
            return self._drop(request, out_dir / POSITIONS_FILE)
        except (AssetError, PhysicsError, ValueError, RuntimeError) as err:
            return Attempt(id=request.id, error=f"{type(err).__name__}: {err}")

    def close(self) -> None:
        """Nothing is to be released."""

    def _drop(self, request: DropRequest, path: Path) -> Attempt:
        garment, build_seconds = _build(request.id)
        mesh = describe_mesh(garment.rest_vertices, garment.faces)
        miss, landmark, _ = measure_landmarks(garment, _build(request.partner)[0])
        begin = time.process_time()
        drop = drop_garment(garment, frames=self.frames, height=self.height)
        drop_seconds = time.process_time() - begin
        if np.isfinite(drop.end).all():
            _save(path, drop.end)
        worst = int(np.argmax(drop.strain))
        return Attempt(
            id=request.id,
            error=drop.error,
            **asdict(mesh),
            particles=drop.particles,
            build_seconds=build_seconds,
            drop_seconds=drop_seconds,
            partner=request.partner,
            landmark_miss=miss,
            landmark=landmark,
            strain_start=float(drop.strain[0]),
            strain_worst=float(drop.strain[worst]),
            strain_worst_frame=worst,
            frames_over=int((drop.strain > STRAIN_LIMIT).sum()),
            strain_end=None if drop.error else float(drop.strain[-1]),
            edge_change=drop.edge_change,
            speed=drop.speed,
            still_seconds=None if drop.still_frame is None else drop.still_frame / 60,
            crossings_start=drop.crossings[0],
            crossings_end=drop.crossings[1],
        )


def find_positions(folder: Path, garment_id: str) -> Path:
    """Give the file with where a garment came to lie: shape (V, 3), float32."""
    return folder / POSITIONS / f"{garment_id}.npy"


def read_attempts(path: Path) -> list[Attempt]:
    """Read every attempt, in the order in which they were finished.

    Args:
        path: One line each. A last line without a line end is what a power cut leaves: it is no
            attempt.

    Raises:
        ValueError: If a whole line is no attempt, or a garment is there twice.
    """
    if not path.exists():
        return []
    *lines, _ = path.read_text(encoding="utf-8", errors="replace").split("\n")
    found: dict[str, Attempt] = {}
    for number, line in enumerate(lines, start=1):
        try:
            attempt = Attempt.from_line(line)
        except ValueError as err:
            raise ValueError(f"{path}, line {number}: {err}") from err
        if attempt.id in found:
            raise ValueError(f"{path}, line {number}: {attempt.id} is there twice")
        found[attempt.id] = attempt
    return list(found.values())


@lru_cache(maxsize=_KEPT)
def _build(garment_id: str) -> tuple[Garment, float]:
    """Make a garment, and say how much CPU time it took [s]."""
    begin = time.process_time()
    garment = load_garment(garment_id)
    return garment, time.process_time() - begin


def _save(path: Path, positions: np.ndarray) -> None:
    with written_beside(path) as partial, partial.open("wb") as file:
        np.save(file, positions)


def _percent(value: float | None) -> str:
    return "unknown" if value is None else f"{100 * value:.2f} %"
