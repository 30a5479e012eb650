"""A simulation of one environment: model, state and solver in one."""

import numpy as np

from dgl_physics.measure import compute_strain
from dgl_physics.model import ModelBuilder
from dgl_physics.solver import SolverXPBD
from dgl_physics.solver_config import SolverConfig
from dgl_physics.state import State

__all__ = ["Scene"]


class Scene:
    """A model of one environment, its state and its solver.

    Attributes:
        model: Constants of the simulation.
        state: Its state.
        solver: Its solver.
    """

    def __init__(
        self, builder: ModelBuilder, config: SolverConfig | None = None, *, device: str = "cpu"
    ) -> None:
        """Build the model.

        Args:
            builder: Garments and shapes of one environment.
            config: Settings of the solver; the default when None.
            device: "cpu", or a CUDA device.
        """
        self.model = builder.build(device)
        self.state = State(self.model)
        self.solver = SolverXPBD(self.model, config)

    def step(self, frames: int = 1) -> None:
        """Advance by a number of frames."""
        for _ in range(frames):
            self.solver.step(self.state)

    def move(self, poses: np.ndarray, *, is_jump: bool = False) -> None:
        """Set the bodies' poses at the end of the coming frame.

        Args:
            poses: xyz [m] + quaternion wxyz of each body without the world, shape (N, 7).
            is_jump: Place the bodies there at once, without velocity.
        """
        world = np.array([[0.0, 0, 0, 1, 0, 0, 0]])
        all_poses = np.concatenate([world, np.reshape(poses, (-1, 7))])
        self.state.set_body_poses(all_poses[None].astype(np.float32), is_jump=is_jump)

    @property
    def x(self) -> np.ndarray:
        """Positions [m], shape (V, 3), float64."""
        return self.state.get_positions()[0].astype(np.float64)

    @property
    def v(self) -> np.ndarray:
        """Velocities [m/s], shape (V, 3), float64."""
        return self.state.get_velocities()[0].astype(np.float64)

    @property
    def mass(self) -> np.ndarray:
        """Mass of each particle [kg], shape (V,); 0 for pinned ones."""
        w = self.model.inverse_mass.numpy().astype(np.float64)
        return np.divide(1.0, w, out=np.zeros_like(w), where=w > 0)

    @property
    def faces(self) -> np.ndarray:
        """Triangles of all garments, shape (F, 3)."""
        return np.concatenate([g.first + g.faces for g in self.model.garments])

    def strain(self) -> np.ndarray:
        """Relative change of length of every edge, shape (E,)."""
        x = self.x
        return np.concatenate(
            [compute_strain(x, g.first + g.edges, g.rest_lengths) for g in self.model.garments]
        )

    def rms_speed(self) -> float:
        """Root mean square speed of the particles [m/s]."""
        return float(np.sqrt((self.v**2).sum(axis=1).mean()))
