"""Garments by id: each id is a seed, so the catalogue needs no files."""

from __future__ import annotations

import zlib
from collections.abc import Callable
from typing import Literal

import numpy as np

from dgl_assets.errors import AssetNotFoundError
from dgl_assets.garments.garment import Garment
from dgl_assets.garments.tops.sampling import sample_top
from dgl_assets.garments.tops.garment import LONG_SLEEVE, make_top

Split = Literal["train", "test"]

_SPLITS: dict[str, range] = {"train": range(8000), "test": range(8000, 10000)}


def _make_random_top(rng: np.random.Generator, *, spacing: float | None, name: str) -> Garment:
    return make_top(sample_top(rng), spacing=spacing, name=name)


_GENERATORS: dict[str, Callable[..., Garment]] = {LONG_SLEEVE: _make_random_top}


def list_categories() -> tuple[str, ...]:
    """Names of the categories of garments."""
    return tuple(_GENERATORS)


def garment_ids(category: str, split: Split, *, count: int | None = None) -> tuple[str, ...]:
    """List ids of generated garments.

    Args:
        category: One of `list_categories()`.
        split: "train" (8,000 garments) or "test" (2,000 others).
        count: Only the first so many; all by default. The paper collects with 100 tops and evaluates on 247.

    Returns:
        Ids such as "Tops_LongSleeve/000123". No id is in both splits.

    Raises:
        AssetNotFoundError: If the category does not exist.
        ValueError: If the split does not exist or has fewer than `count` garments.
    """
    _check_category(category)
    if split not in _SPLITS:
        raise ValueError(f"split must be one of {sorted(_SPLITS)}; got {split!r}")
    numbers = _SPLITS[split]
    if count is not None and not 0 <= count <= len(numbers):
        raise ValueError(f"count must be in [0, {len(numbers)}] for split {split}; got {count}")
    return tuple(f"{category}/{number:06d}" for number in numbers[:count])


def load_garment(garment_id: str, *, spacing: float | None = None) -> Garment:
    """Make the garment of an id.

    Args:
        garment_id: Category and six digits, such as "Tops_LongSleeve/000123".
        spacing: Target edge length [m].

    Returns:
        The garment; the same arrays each time.

    Raises:
        AssetNotFoundError: If the category or the number does not exist.
    """
    category, _, digits = garment_id.partition("/")
    _check_category(category)
    last = _SPLITS["test"].stop - 1
    if not (len(digits) == 6 and digits.isascii() and digits.isdigit() and int(digits) <= last):
        raise AssetNotFoundError(
            f"expected {category}/ followed by six digits from 000000 to {last:06d}; got {garment_id!r}"
        )
    # The category takes part in the seed, so that number 7 of two categories is not one body.
    rng = np.random.default_rng([zlib.crc32(category.encode()), int(digits)])
    return _GENERATORS[category](rng, spacing=spacing, name=garment_id)


def _check_category(category: str) -> None:
    if category not in _GENERATORS:
        raise AssetNotFoundError(
            f"unknown category {category!r}; expected one of {sorted(_GENERATORS)}"
        )
