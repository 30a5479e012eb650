"""Exceptions that a caller may want to catch."""

__all__ = ["DataError", "GamCheckpointError", "GamError", "WeightsNotFoundError"]


class GamError(Exception):
    """Base of the errors of this package. Wrong arguments raise `ValueError` instead."""


class GamCheckpointError(GamError):
    """A file is not a checkpoint of this package, is damaged, or does not fit."""


class DataError(GamError):
    """A file of training data is damaged or not in the format, or a folder holds none that fit."""


class WeightsNotFoundError(GamError):
    """There are no trained weights for what was asked."""
