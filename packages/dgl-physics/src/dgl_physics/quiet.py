"""Warp without its banner, a line for each module that it loads, and noise about GPUs."""

import logging
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path

import warp as wp

__all__ = ["quiet_warp"]

_GPU_FILES = (Path("/proc/driver/nvidia"), Path("/dev/dxg"))
"""Made by the kernel driver of an NVIDIA GPU, on Linux and on WSL."""
_NO_DRIVER = b"Could not find or load the NVIDIA CUDA driver"


@contextmanager
def quiet_warp() -> Iterator[None]:
    """Hold back what Warp prints at its default log level, during a call or a block.

    A level that the user has set, such as `wp.LOG_DEBUG`, is left alone.
    """
    level = wp.config.log_level
    if level == logging.INFO:
        wp.config.log_level = logging.WARNING
    try:
        _start_warp()
        yield
    finally:
        wp.config.log_level = level


@cache
def _start_warp() -> None:
    """Start Warp, without its warning of a missing driver on a machine without an NVIDIA GPU.

    Warp's native code writes the warning to the process's standard error, whatever the log level.
    """
    if sys.stderr is None or any(file.exists() for file in _GPU_FILES):
        wp.init()
        return
    with os.fdopen(os.memfd_create("warp"), "w+b") as held, _standard_error_to(held.fileno()):
        wp.init()
        os.lseek(held.fileno(), 0, os.SEEK_SET)
        told = [line for line in held if _NO_DRIVER not in line]
    os.write(2, b"".join(told))


@contextmanager
def _standard_error_to(descriptor: int) -> Iterator[None]:
    before = os.dup(2)
    os.dup2(descriptor, 2)
    try:
        yield
    finally:
        os.dup2(before, 2)
        os.close(before)
