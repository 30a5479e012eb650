"""Garments by id, which is a seed: the catalogue needs no files."""

from __future__ import annotations

import difflib
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal

import numpy as np

from dgl_assets.errors import AssetNotFoundError
from dgl_assets.garments.cache import find_cached, store_garment
from dgl_assets.garments.garment import Garment
from dgl_assets.garments.registry import (
    CATEGORIES,
    Category,
    get_category,
    make_garment,
    sample_measures,
)
from dgl_assets.garments.sizes import Sizes
from dgl_assets.ranges import check_choice

Split = Literal["train", "test"]
Subset = Literal["paper"]


def list_categories() -> tuple[str, ...]:
    """Names of the categories of garments."""
    return tuple(CATEGORIES)


def choose_categories(names: Sequence[str] = ()) -> tuple[str, ...]:
    """Look up categories, in the catalogue's order; all when none is named.

    Raises:
        ValueError: If one does not exist; the message names the closest.
    """
    known = list_categories()
    for name in names:
        if name not in known:
            close = difflib.get_close_matches(name, known, n=1)
            hint = f"did you mean {close[0]}?" if close else f"they are: {', '.join(known)}"
            raise ValueError(f"unknown category {name!r}; {hint}")
    return tuple(name for name in known if not names or name in names)


def garment_ids(
    category: str,
    split: Split,
    *,
    sizes: Sizes = "reach",
    subset: Subset | None = None,
    count: int | None = None,
    measures: Mapping[str, str | tuple[float, float]] | None = None,
) -> tuple[str, ...]:
    """List ids of generated garments.

    Args:
        category: One of `list_categories()`.
        split: "train" or "test". No id is in both.
        sizes: "reach" for garments that both robots reach, "all" for others from children to XXL.
            No id is in both.
        subset: "paper" for as many as the paper collected with ("train") and evaluated on besides
            ("test"); None for all.
        count: Number of ids from the first on; None for all.
        measures: Words, and limits (low, high) of numbers, by the name of the measure: garments of
            other measures are left out.

    Returns:
        Ids such as "Tops_LongSleeve/000123": 8,000 for training and 2,000 for testing, for each
        choice of sizes, if none is left out.

    Raises:
        AssetNotFoundError: If the category does not exist.
        ValueError: If split, sizes, subset or a measure do not exist, there are fewer than `count`
            ids, or the measures leave none.
    """
    entry = get_category(category)
    check_choice("split", split, ("test", "train"))
    check_choice("sizes", sizes, ("reach", "all"))
    if subset not in (None, "paper"):
        raise ValueError(f"subset must be None or 'paper'; got {subset!r}")
    start = 0 if sizes == "reach" else entry.train_count + entry.test_count
    available, paper = entry.train_count, entry.paper_train
    if split == "test":
        start += entry.train_count
        available, paper = entry.test_count, entry.paper_all - entry.paper_train
    if subset == "paper":
        available = paper
    if count is not None and not 0 <= count <= available:
        raise ValueError(f"count must be in [0, {available}] for split {split}; got {count}")
    numbers = range(start, start + (available if count is None else count))
    if measures:
        limits = tuple(sorted(measures.items()))
        numbers = [number for number in numbers if _fits(entry.name, number, limits)]
        if not numbers:
            raise ValueError(f"no garment of {category} has the measures {dict(measures)}")
    return tuple(f"{category}/{number:06d}" for number in numbers)


@lru_cache(maxsize=50_000)
def _fits(category: str, number: int, limits: tuple[tuple[str, Any], ...]) -> bool:
    values = asdict(_draw_measures(get_category(category), number))
    unknown = sorted(name for name, _ in limits if name not in values)
    if unknown:
        raise ValueError(f"measures of {category} are {sorted(values)}; got {unknown}")
    return all(
        values[name] == limit if isinstance(limit, str) else limit[0] <= values[name] <= limit[1]
        for name, limit in limits
    )


def load_garment(
    garment_id: str, *, spacing: float | None = None, cache: Path | None = None
) -> Garment:
    """Make the garment of an id.

    Args:
        garment_id: Category and six digits, such as "Tops_LongSleeve/000123".
        spacing: Target edge length [m]; None for 13 mm, adapted to the size of the garment.
        cache: Folder of built garments, see `build_garments`; missing garments are made and added.

    Returns:
        The garment; the same arrays each time.

    Raises:
        AssetNotFoundError: If the category or the number does not exist.
        CacheError: If the file in the cache is damaged, or of another version of the generator.
        ValueError: If `spacing` is given with a `cache`, which holds the default spacing.
    """
    entry, number = _parse_id(garment_id)
    if cache is None:
        return _make(entry, number, garment_id, spacing=spacing)
    if spacing is not None:
        raise ValueError(f"a cache holds garments of the default spacing; got spacing {spacing}")
    garment = find_cached(cache, garment_id)
    if garment is None:
        garment = _make(entry, number, garment_id, spacing=None)
        store_garment(cache, garment)
    return garment


def check_id(garment_id: str) -> None:
    """Check that an id exists, without making its garment.

    Raises:
        AssetNotFoundError: If the category or the number does not exist.
    """
    _parse_id(garment_id)


def _make(entry: Category, number: int, name: str, *, spacing: float | None) -> Garment:
    return make_garment(_draw_measures(entry, number), spacing=spacing, name=name)


def _draw_measures(entry: Category, number: int) -> Any:
    # The category is part of the seed, so that equal numbers of two categories have other bodies.
    rng = np.random.default_rng([zlib.crc32(entry.name.encode()), number])
    sizes: Sizes = "reach" if number < entry.train_count + entry.test_count else "all"
    return sample_measures(entry.name, rng, sizes=sizes)


def _parse_id(garment_id: str) -> tuple[Category, int]:
    name, _, digits = garment_id.partition("/")
    entry = get_category(name)
    last = 2 * (entry.train_count + entry.test_count) - 1
    if not (len(digits) == 6 and digits.isascii() and digits.isdigit() and int(digits) <= last):
        raise AssetNotFoundError(
            f"expected {name}/ followed by six digits from 000000 to {last:06d}; got {garment_id!r}"
        )
    return entry, int(digits)
