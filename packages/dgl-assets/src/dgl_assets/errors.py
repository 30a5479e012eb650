"""Errors of this package."""


class AssetError(Exception):
    """Base of the errors of this package."""


class AssetNotFoundError(AssetError):
    """Raised when a category or an asset id does not exist."""


class MeshingError(AssetError):
    """Raised when an outline cannot be filled with triangles of the requested size."""


class CacheError(AssetError):
    """Raised when a file in a cache of garments cannot be used."""
