# type: ignore  # kernels are in the language of Warp
"""Damping in proportion to the stiffness of a constraint."""

import warp as wp

COUPLING = wp.constant(4.0)
"""Inverse mass that a change meets through neighbours, over the constraint's own."""


@wp.func
def compute_damping(
    before: wp.float32,
    value: wp.float32,
    steps: wp.float32,
    compliance: wp.float32,
    w: wp.float32,
):
    """Compute the damping part of a constraint's multiplier.

    The force is `steps`, the relaxation time in substeps, times the stiffness times the change of
    the constraint's value since the last pass over it; 0 where `before` is negative (unknown). The
    change is between the same passes of two substeps, so it is zero at rest and damping moves no
    equilibrium, unlike the change within a substep (Macklin et al. 2016, eq. 26). It never
    reverses the change, and fades out where the substep does not resolve the stiffness.
    """
    if steps == 0.0 or before < 0.0:
        return float(0.0)
    resolved = compliance / (compliance + w)
    return resolved * steps * (value - before) / wp.max(compliance, COUPLING * w * steps)
