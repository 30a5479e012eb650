"""Settings of the solver."""

# What wp.struct returns is no class to pyright.
# pyright: reportGeneralTypeIssues=false
from dataclasses import dataclass
from typing import get_args

from dgl_physics._kernels.types import SolverLimits
from dgl_physics.launcher import CpuCode

__all__ = ["SolverConfig"]


@dataclass(frozen=True, kw_only=True)
class SolverConfig:
    """Settings of the solver."""

    dt: float = 1 / 60
    """Length of a frame [s]; > 0."""
    substeps: int = 10
    """Substeps of a frame, each of one iteration; >= 1."""
    coarse_sweeps: int = 3
    """Passes over the limits of the coarse level in each substep; 0 leaves it out."""
    search_every: int = 5
    """Substeps after which particle contacts are searched for, where particles moved; >= 1."""
    neighbour_margin: float = 0.005
    """Distance beyond thickness and adhesion that a search covers [m]; > 0. A particle may move
    by half of it without a new search."""
    neighbour_capacity: int = 256
    """Initial room for neighbours of higher index of a particle, >= 1; full lists grow."""
    near_capacity: int = 96
    """Initial room for shapes near a particle, likewise; >= 1."""
    list_memory: float = 2.0
    """Most memory that either kind of lists may grow to [GiB]; > 0."""
    sleep_distance: float = 1.5e-3
    """Cloth is still while its particles stay within this root mean square distance over an
    environment [m]; 0 for cloth that never sleeps."""
    sleep_after: float = 0.5
    """Still time after which an environment's cloth sleeps [s]; > 0. It wakes when a movable body
    comes near, or when particles or gravity are set."""
    max_speed: float = 15.0
    """Bound on the speed of particles [m/s]."""
    separation_speed: float = 0.1
    """Largest velocity that a contact gives by undoing an overlap [m/s]; > 0. The overlap itself is
    undone at once."""
    gravity: tuple[float, float, float] = (0.0, 0.0, -9.81)
    """[m/s^2], world frame."""
    is_guarded: bool = True
    """Raise when particles diverge, and let full lists grow. Without it neither is checked, and
    contacts that find no room are left out."""
    cpu_code: CpuCode = "auto"
    """Code for a CPU: "vector" solves eight constraints at a time, "warp" one; "auto" is vector
    code on x86 with AVX2 and FMA and on 64-bit Arm. Results are the same, to the bit."""

    def __post_init__(self) -> None:
        for name in ("dt", "neighbour_margin", "list_memory", "sleep_after"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} must be > 0; got {getattr(self, name)}")
        for name in ("substeps", "search_every", "neighbour_capacity", "near_capacity"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name} must be >= 1; got {getattr(self, name)}")
        if not self.sleep_distance >= 0:
            raise ValueError(f"sleep_distance must be >= 0; got {self.sleep_distance}")
        if self.cpu_code not in get_args(CpuCode):
            raise ValueError(
                f"cpu_code must be one of {list(get_args(CpuCode))}; got {self.cpu_code!r}"
            )

    def make_limits(self, contact_reach: float) -> SolverLimits:
        """Return the settings of the kernels.

        Args:
            contact_reach: Largest distance at which two particles act on each other [m].
        """
        limits = SolverLimits()
        limits.max_speed = self.max_speed
        limits.separation_speed = self.separation_speed
        limits.neighbour_margin = self.neighbour_margin
        limits.neighbour_capacity = self.neighbour_capacity
        limits.near_capacity = self.near_capacity
        limits.sleep_distance = self.sleep_distance
        limits.sleep_frames = max(1, round(self.sleep_after / self.dt))
        # A query visits few cells.
        limits.cell_size = 2.0 * (contact_reach + self.neighbour_margin)
        return limits
