# type: ignore  # kernels are in the language of Warp
"""Detection of diverged particles.

Compiled without fast mathematics, which assumes that there are no NaNs.
"""

import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.kernel
def flag_divergence(
    particles_per_env: wp.int32,
    extent: wp.float32,
    inverse_mass: wp.array(dtype=wp.float32),
    position: wp.array(dtype=wp.vec3),
    flag: wp.array(dtype=wp.int32),
):
    """Mark environments with a particle that is not finite or too far away."""
    i = wp.tid()
    if inverse_mass[i] > 0.0:
        x = position[i]
        if not (wp.length(x) < extent):
            flag[i // particles_per_env] = 1
