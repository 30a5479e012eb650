"""Memory of this process."""

import os
from pathlib import Path

__all__ = ["measure_process_memory"]


def measure_process_memory() -> int:
    """Measure the resident memory of this process [bytes]."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE")
