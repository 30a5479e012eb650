"""Sample clouds: two test garments of each category, flat and in other states."""

from pathlib import Path

from dgl_gam.data.folder import GarmentFolder
from dgl_gam.data.garment_file import GarmentData

__all__ = ["SAMPLES", "list_samples", "load_samples"]

SAMPLES = Path(__file__).parent
"""Folder of the files."""


def list_samples() -> tuple[str, ...]:
    """List the categories that there are samples of."""
    return GarmentFolder(SAMPLES).categories


def load_samples(category: str) -> tuple[GarmentData, GarmentData]:
    """Load two garments of a category.

    Args:
        category: Such as "Tops_LongSleeve".

    Returns:
        The garments; their first view shows them lying flat, from above.

    Raises:
        ValueError: If there are no samples of the category.
    """
    folder = GarmentFolder(SAMPLES)
    if category not in folder.categories:
        raise ValueError(
            f"category must be one of {', '.join(folder.categories)}; got {category!r}"
        )
    first, second = (folder.load(index) for index in folder.get_indices(category))
    return first, second
