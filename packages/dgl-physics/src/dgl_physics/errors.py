"""Exceptions of dgl-physics."""


class PhysicsError(Exception):
    """Base of all errors raised by dgl-physics."""


class MeshError(PhysicsError, ValueError):
    """A mesh cannot be simulated; the message says what is wrong and where."""


class SimulationDivergedError(PhysicsError):
    """Particles became non-finite or left the simulated space.

    Attributes:
        step: Number of frames that had been simulated when it was noticed.
        env_indices: Environments that diverged.
    """

    def __init__(self, step: int, env_indices: list[int]) -> None:
        super().__init__(
            f"simulation diverged at frame {step} in environment(s) {env_indices}; "
            "use more substeps or slower motion"
        )
        self.step = step
        self.env_indices = env_indices


class ContactOverflowError(PhysicsError):
    """A particle has more neighbours or near shapes than the model has room for."""


class UnsupportedCpuError(PhysicsError):
    """The CPU lacks the instructions of the code that was asked for."""
