"""The kernel that `doctor` runs; in a module of its own, because it imports Warp and Warp reads its source."""

import warp as wp

__all__ = ["double"]


@wp.kernel
def double(values: wp.array(dtype=float)):  # pyright: ignore[reportInvalidTypeForm]
    """Double each value."""
    i = wp.tid()
    values[i] = 2.0 * values[i]
