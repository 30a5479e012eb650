"""Ground truth of the scene, for success rules."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy.spatial.transform import Rotation

from dgl_tasks.coverage import sample_visible_surface
from dgl_tasks.enclosing import is_enclosed

SLICE = 0.03
"""Width of the slices whose middles are the midline [m]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class TrueView:
    """The simulation's state; implements `dgl_tasks.success.SceneView`."""

    particles: np.ndarray
    """Vertices of the garment's surface [m], shape (V, 3), world frame."""
    faces: np.ndarray
    """Its triangles, shape (F, 3)."""
    upright: np.ndarray
    """Its vertices upright, or lying flat, shape (V, 3)."""
    landmarks: Mapping[str, np.ndarray]
    """As in `SceneView`."""
    marks: Mapping[str, int] = field(default_factory=dict)
    """Vertex of each of the rule's marks."""
    flat_area: float
    """As in `SceneView`."""
    frames: Mapping[str, Mapping[str, np.ndarray]]
    """As in `SceneView`."""

    @cached_property
    def top(self) -> np.ndarray:
        """Surface visible from straight above [m], shape (N, 3)."""
        return sample_visible_surface(self.particles, self.faces)

    @cached_property
    def tilt(self) -> float:
        """Angle between upward axes of garment and world, after the best rigid motion [rad]."""
        turn = Rotation.align_vectors(
            self.particles - self.particles.mean(axis=0), self.upright - self.upright.mean(axis=0)
        )[0]
        return float(np.arccos(np.clip(turn.as_matrix()[2, 2], -1.0, 1.0)))

    @cached_property
    def midline(self) -> np.ndarray:
        """Middles of slices across the longest direction of the flat garment [m], shape (B, 3)."""
        axis = int(np.ptp(self.upright, axis=0).argmax())
        along = self.upright[:, axis]
        count = max(2, round(float(np.ptp(along)) / SLICE))
        slices = np.clip((along - along.min()) / np.ptp(along) * count, 0, count - 1).astype(int)
        weights = np.bincount(slices, minlength=count)
        sums = [np.bincount(slices, each, minlength=count) for each in self.particles.T]
        return (np.stack(sums, axis=1) / np.maximum(weights, 1)[:, None])[weights > 0]

    @property
    def places(self) -> Mapping[str, np.ndarray]:
        """The marks now [m], shape (3,)."""
        return {name: self.particles[vertex] for name, vertex in self.marks.items()}

    def enclose(self, points: np.ndarray) -> np.ndarray:
        """Tell which points [m], shape (N, 3), the garment encloses."""
        return is_enclosed(points, self.particles, self.faces)

    @property
    def surface(self) -> np.ndarray:
        """Vertices of the garment's surface [m], shape (V, 3): they lie evenly on it."""
        return self.particles
