# type: ignore  # kernels are in the language of Warp
"""Reset the solver's memory of the last substep where particles were set."""

from typing import Any

import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.kernel
def forget_lengths(
    is_set: wp.array(dtype=wp.int32),
    environment: wp.array(dtype=wp.int32),
    particles: wp.array(dtype=Any),
    unknown: Any,
    lengths: wp.array(dtype=Any),
):
    """Set the remembered length of a constraint between `particles` to `unknown`."""
    k = wp.tid()
    if is_set[environment[particles[k][0]]] == 1:
        lengths[k] = unknown


@wp.kernel
def take_counts(
    is_set: wp.array(dtype=wp.int32),
    environment: wp.array(dtype=wp.int32),
    counted: wp.array(dtype=wp.float32),
    crowd: wp.array(dtype=wp.float32),
):
    """Copy the counts of environments whose particles were set."""
    i = wp.tid()
    if is_set[environment[i]] == 1:
        crowd[i] = counted[i]
