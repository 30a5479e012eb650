"""Warp without its banner and without a line for each module that it loads."""

import logging
from collections.abc import Iterator
from contextlib import contextmanager

import warp as wp

__all__ = ["quiet_warp"]


@contextmanager
def quiet_warp() -> Iterator[None]:
    """Hold back what Warp prints at its default log level, during a call or a block.

    A level that the user has set, such as `wp.LOG_DEBUG`, is left alone.
    """
    level = wp.config.log_level
    if level == logging.INFO:
        wp.config.log_level = logging.WARNING
    try:
        yield
    finally:
        wp.config.log_level = level
