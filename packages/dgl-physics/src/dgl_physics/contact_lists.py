"""Lists of what is near each particle, which grow when they are too short."""

from dgl_physics.errors import ContactOverflowError

__all__ = ["grow_list"]

_GIB = 2**30


def grow_list(what: str, size: int, memory: float) -> int:
    """Give the size of lists that have room for twice as much.

    Args:
        what: They hold.
        size: That they have now, in entries of 4 bytes.
        memory: That they may take [GiB].

    Raises:
        ContactOverflowError: If they would take more.
    """
    needed = 2 * size * 4 / _GIB
    if needed > memory:
        raise ContactOverflowError(
            f"lists of {what} are too short and would need {needed:.3g} GiB; list_memory of SolverConfig allows {memory:g}"
        )
    return 2 * size
