"""Growth of the lists of neighbours and shapes near each particle."""

from dgl_physics.errors import ContactOverflowError

__all__ = ["grow_list"]

_GIB = 2**30


def grow_list(what: str, size: int, memory: float) -> int:
    """Double the `size` of lists, in entries of 4 bytes.

    Raises:
        ContactOverflowError: If they would take more than `memory` [GiB].
    """
    needed = 2 * size * 4 / _GIB
    if needed > memory:
        raise ContactOverflowError(
            f"lists of {what} are too short and would need {needed:.3g} GiB; "
            f"list_memory of SolverConfig allows {memory:g}"
        )
    return 2 * size
