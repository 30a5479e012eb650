"""Launches of kernels, on a CPU also as their twins in vector code."""

import logging
import platform
from collections.abc import Callable
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Literal

import warp as wp

from dgl_physics.errors import UnsupportedCpuError

__all__ = ["CpuCode", "Launcher", "find_vector_obstacle"]

CpuCode = Literal["auto", "vector", "warp"]
"""Code for a CPU: vector code, Warp's own, or "auto" for vector code where it can run."""

Kernel = Callable[..., None]
"""Result of `wp.kernel`; a function to type checkers."""
WANTED = ("avx2", "fma")
"""Flags of an x86 processor that vector code needs, as named by Linux."""

logger = logging.getLogger(__name__)


def find_vector_obstacle(cpu_info: Path = Path("/proc/cpuinfo")) -> str | None:
    """Explain the lack of vector code on this CPU; None where it runs.

    Args:
        cpu_info: Linux's description of the processors.
    """
    machine = platform.machine().lower()
    if machine in ("aarch64", "arm64"):
        return None
    if machine not in ("x86_64", "amd64"):
        return f"its architecture is {machine}"
    if not cpu_info.is_file():
        return f"{cpu_info} is missing, which says what the CPU can do"
    flags = next(
        (line for line in cpu_info.read_text().splitlines() if line.startswith("flags")), ""
    )
    missing = [name for name in WANTED if name not in flags.split()]
    return f"it lacks {' and '.join(missing)}" if missing else None


@cache
def warn_once(obstacle: str) -> None:
    """Warn once in a process that cloth is slow."""
    logger.warning("cloth runs without vector code, about three times slower: %s", obstacle)


class Launcher:
    """Launches kernels on one device; see `dgl_physics._kernels.vector` for their twins."""

    def __init__(self, device: str, cpu_code: CpuCode, particle_count: int) -> None:
        """Choose the code; raises UnsupportedCpuError for vector code that cannot run."""
        self._is_cpu = device == "cpu"
        self._twins: dict[Kernel, Kernel] = {}
        self._starts: dict[tuple[int, ...], wp.array] = {}
        obstacle = find_vector_obstacle() if self._is_cpu and cpu_code != "warp" else None
        if obstacle and cpu_code == "vector":
            raise UnsupportedCpuError(
                f'this CPU runs no vector code: {obstacle}; use cpu_code="auto" or "warp"'
            )
        if obstacle:
            warn_once(obstacle)
        elif self._is_cpu and cpu_code != "warp":
            from dgl_physics._kernels.vector.twins import TWINS

            self._twins = TWINS
        self._scratch = wp.zeros(
            32 * particle_count + 8192 if self._twins else 0, dtype=wp.int32, device=device
        )

    def has_twin(self, kernel: Kernel) -> bool:
        """Return True if a kernel runs as vector code."""
        return kernel in self._twins

    def launch(self, kernel: Kernel, dim: int, inputs: list) -> None:
        """Launch a kernel, or its twin, with `dim` threads."""
        if twin := self._twins.get(kernel):
            wp.launch(twin, dim=1, inputs=[dim, *inputs, self._scratch])
        else:
            wp.launch(kernel, dim=dim, inputs=inputs)

    def launch_colours(self, kernel: Kernel, colour_start: tuple[int, ...], inputs: list) -> None:
        """Launch a kernel on constraints, one colour after another.

        Its first argument is the first constraint of the launch; `inputs` are the others.
        """
        if twin := self._twins.get(kernel):
            if colour_start not in self._starts:
                self._starts[colour_start] = wp.array(colour_start, dtype=wp.int32, device="cpu")
            inputs = [self._starts[colour_start], *inputs, self._scratch]
            wp.launch(twin, dim=1, inputs=inputs)
            return
        if self._is_cpu:
            # One thread takes the constraints in their order, so all colours share a launch.
            colour_start = (colour_start[0], colour_start[-1])
        for first, end in pairwise(colour_start):
            wp.launch(kernel, dim=end - first, inputs=[first, *inputs])
