# type: ignore  # kernels are in the language of Warp
"""What a solver remembers of the substep before is forgotten where particles were set."""

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
    """Make a constraint's length unknown, which is negative; `particles` are those that it is about."""
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
    """Take over what was counted."""
    i = wp.tid()
    if is_set[environment[i]] == 1:
        crowd[i] = counted[i]
