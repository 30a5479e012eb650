"""Looking for particles that went astray, and for those that moved since the last search.

Compiled without fast mathematics, which would assume that there are no NaNs.
"""

# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false, reportIndexIssue=false
# pyright: reportOperatorIssue=false
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


@wp.kernel
def measure_displacement(
    particles_per_env: wp.int32,
    inverse_mass: wp.array(dtype=wp.float32),
    position: wp.array(dtype=wp.vec3),
    searched_at: wp.array(dtype=wp.vec3),
    displacement: wp.array(dtype=wp.float32),
):
    """Largest distance of a particle from where the last search found it, by environment.

    Far away where a position is not finite, so that the search and then the guard see it.
    """
    i = wp.tid()
    if inverse_mass[i] > 0.0:
        d = wp.length(position[i] - searched_at[i])
        if not (d < 1.0e6):
            d = 1.0e6
        wp.atomic_max(displacement, i // particles_per_env, d)
