# type: ignore  # kernels are in the language of Warp
"""Damping in proportion to the stiffness of a constraint."""

import warp as wp

COUPLING = wp.constant(4.0)
"""How much more inverse mass a change meets than a constraint's own, through its neighbours."""


@wp.func
def compute_damping(
    before: wp.float32,
    value: wp.float32,
    steps: wp.float32,
    compliance: wp.float32,
    w: wp.float32,
):
    """Compute what damping adds to the multiplier of a constraint.

    The force is `steps` times the stiffness times the change of the constraint's value since the
    last pass over it, with the relaxation time in substeps as `steps`; 0 when nothing is known of
    what was before, which is not looked at then. The change is taken at the same place of the
    passes, so it is zero at rest and damping moves no equilibrium, unlike the change within the
    substep (Macklin et al. 2016, eq. 26), which the other constraints have only undone in part. It
    is held below what would turn the change around, and fades out where the substep does not
    resolve the stiffness.
    """
    if steps == 0.0 or before < 0.0:
        return float(0.0)
    resolved = compliance / (compliance + w)
    return resolved * steps * (value - before) / wp.max(compliance, COUPLING * w * steps)
