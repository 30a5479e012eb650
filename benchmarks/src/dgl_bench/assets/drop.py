"""One garment is laid flat above the ground and let go."""

from dataclasses import dataclass

import numpy as np

from dgl_assets import Garment
from dgl_collect.gam_data.simulation import add_garment
from dgl_physics import ModelBuilder, PhysicsError
from dgl_physics.measure import find_intersections
from dgl_physics.scene import Scene

__all__ = ["FRAMES", "HEIGHT", "Drop", "drop_garment"]

FRAMES = 300
"""5 s at the default 60 frames a second."""
HEIGHT = 0.03
"""Of a garment's lowest point above the ground before it is let go [m]."""


@dataclass(frozen=True, kw_only=True)
class Drop:
    """Record of one drop."""

    start: np.ndarray
    """Vertices at the release [m], shape (V, 3)."""
    end: np.ndarray
    """Vertices at the end [m], shape (V, 3), float32; of a shell the outer side. Not finite after
    some errors."""
    strain: np.ndarray
    """Mean over all edges of the change of length, regardless of its sign, as let go and after each
    frame that was simulated, shape (T,). An elastic shell's edges are those of its tetrahedra."""
    edge_change: float | None
    """Largest change of length of one edge at the end; None after an error."""
    speed: float | None
    """Root mean square speed at the end [m/s]; None after an error."""
    still_frame: int | None
    """First frame after which it slept to the end, or None if it moved on."""
    crossings: tuple[int, int | None]
    """Edges that pierce a triangle of another place of the garment, at the start and at the end."""
    particles: int
    """Number of particles; a shell has an inner side too."""
    error: str = ""
    """Why the simulation ended early; empty when it did not."""


def drop_garment(garment: Garment, *, frames: int = FRAMES, height: float = HEIGHT) -> Drop:
    """Drop a garment flat onto the ground, at the default configuration of dgl-physics.

    Args:
        garment: Of the catalogue. Cloth falls as it lies in two layers; an elastic shell as it
            stands or lies.
        frames: How long [1/60 s].
        height: Of its lowest point above the ground [m].
    """
    builder = ModelBuilder()
    start = garment.vertices.astype(np.float64)
    start[:, 2] += height - start[:, 2].min()
    add_garment(builder, garment, start)
    builder.add_ground()
    scene = Scene(builder)
    strain = [np.abs(scene.strain()).mean()]
    still_frame, error = None, ""
    sleep_frames = max(1, round(scene.solver.config.sleep_after / scene.solver.config.dt))
    for frame in range(1, frames + 1):
        try:
            scene.step()
        except PhysicsError as err:
            error = f"{type(err).__name__}: {err}"
            break
        if scene.state.still.numpy()[0] < sleep_frames:
            still_frame = None
        elif still_frame is None:
            still_frame = frame
        else:  # it sleeps: no particle has moved
            strain.append(strain[-1])
            continue
        strain.append(np.abs(scene.strain()).mean())
    end = scene.x[: len(start)]
    if not error and not np.isfinite(scene.x).all():
        error = "positions are not finite"
    first = len(find_intersections(start, garment.faces))
    return Drop(
        start=start,
        end=end.astype(np.float32),
        strain=np.array(strain),
        edge_change=None if error else float(np.abs(scene.strain()).max()),
        speed=None if error else scene.rms_speed(),
        still_frame=None if error else still_frame,
        crossings=(first, None if error else len(find_intersections(end, garment.faces))),
        particles=len(scene.x),
        error=error,
    )
