"""Kernel of `dgl doctor`, in its own module, since Warp is imported and reads the source."""

import warp as wp

__all__ = ["double"]


@wp.kernel
def double(values: wp.array(dtype=float)):  # pyright: ignore[reportInvalidTypeForm]
    """Double each value."""
    i = wp.tid()
    values[i] = 2.0 * values[i]
