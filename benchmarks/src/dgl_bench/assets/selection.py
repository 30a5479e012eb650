"""Selection of garments: equal shares of each category, each split, and sizes in reach and all."""

from collections.abc import Sequence
from typing import Literal

from dgl_assets import choose_categories, garment_ids

__all__ = ["find_partners", "select_ids"]

_POOLS: tuple[tuple[Literal["train", "test"], Literal["reach", "all"]], ...] = (
    ("train", "reach"),
    ("test", "reach"),
    ("train", "all"),
    ("test", "all"),
)


def select_ids(count: int, categories: Sequence[str] = ()) -> tuple[str, ...]:
    """Select garments of the catalogue, always the same.

    Each category has an equal share, and within it each of training and testing, reach and all
    sizes, spread evenly over their ids. Categories take turns, so that the first part of a run has
    some of each.

    Args:
        count: How many; at least one of each category.
        categories: Names; all when there are none.

    Returns:
        Ids such as "Tops_LongSleeve/000123".

    Raises:
        ValueError: If a category does not exist, or `count` is below the categories' number or
            above that of the ids.
    """
    chosen = choose_categories(categories)
    if count < len(chosen):
        raise ValueError(f"count must be at least {len(chosen)}, one of each category; got {count}")
    columns = [
        _spread(name, count // len(chosen) + (index < count % len(chosen)))
        for index, name in enumerate(chosen)
    ]
    longest = max(len(column) for column in columns)
    return tuple(column[row] for row in range(longest) for column in columns if row < len(column))


def find_partners(ids: Sequence[str]) -> dict[str, str]:
    """Pair each garment with the one of its category selected before it; the first with the last.

    Returns:
        Id to id; a garment that is alone in its category has itself.
    """
    by_category: dict[str, list[str]] = {}
    for garment_id in ids:
        by_category.setdefault(garment_id.partition("/")[0], []).append(garment_id)
    return {own[k]: own[k - 1] for own in by_category.values() for k in range(len(own))}


def _spread(category: str, count: int) -> list[str]:
    """Choose ids of one category, the pools by turns."""
    picked: list[list[str]] = []
    for index, (split, sizes) in enumerate(_POOLS):
        pool = garment_ids(category, split, sizes=sizes)
        share = count // len(_POOLS) + (index < count % len(_POOLS))
        if share > len(pool):
            raise ValueError(
                f"count must leave at most {len(_POOLS) * len(pool)} garments to a category; got "
                f"{count} of {category}"
            )
        picked.append([pool[(2 * k + 1) * len(pool) // (2 * share)] for k in range(share)])
    return [pool[row] for row in range(max(map(len, picked))) for pool in picked if row < len(pool)]
