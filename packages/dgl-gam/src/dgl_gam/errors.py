"""Exceptions that a caller may want to catch."""

__all__ = ["GamError"]


class GamError(Exception):
    """Base of the errors of this package. Wrong arguments raise `ValueError` instead."""
