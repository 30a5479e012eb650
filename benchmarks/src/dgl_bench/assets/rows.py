"""Rows of a run: measures of all garments and of each category, beside their thresholds."""

import statistics
from collections.abc import Callable, Iterable, Sequence

from dgl_bench.assets.attempts import STRAIN_LIMIT, Attempt
from dgl_bench.rows import Row

__all__ = ["PARTICLE_RANGE", "group", "make_rows", "summarise"]

PARTICLE_RANGE = (1500, 8000)
"""Accepted particles of a garment, both included."""


def group(attempts: Iterable[Attempt]) -> dict[str, list[Attempt]]:
    """Sort garments by category, each category's by their worst mean strain, errors first."""
    by_category: dict[str, list[Attempt]] = {}
    for attempt in attempts:
        by_category.setdefault(attempt.category, []).append(attempt)
    for own in by_category.values():
        own.sort(key=lambda a: (not a.error, -(a.strain_worst or 0.0), a.id))
    return by_category


def make_rows(attempts: Sequence[Attempt]) -> list[Row]:
    """Make the rows of all garments and, where there are several categories, of each."""
    rows = summarise("all", attempts)
    categories = group(attempts)
    for name, own in categories.items() if len(categories) > 1 else ():
        rows += summarise(name, own)
    return rows


def summarise(name: str, attempts: Sequence[Attempt]) -> list[Row]:
    """Make the rows of some garments, each named after them and what was measured: `all.whole`."""
    built = [a for a in attempts if a.edge_share is not None]
    dropped = [a for a in built if not a.error]
    low, high = PARTICLE_RANGE
    is_sized = [low <= a.particles <= high for a in built]
    return [
        Row(name=f"{name}.garments", value=float(len(attempts)), unit=""),
        Row(
            name=f"{name}.errors",
            value=float(sum(bool(a.error) for a in attempts)),
            unit="",
            bar="<= 0",
            note="not built, diverged, not finite, or too many contacts",
        ),
        Row(
            name=f"{name}.whole",
            value=_share([a.is_whole for a in attempts]),
            unit="%",
            bar=">= 100",
            note=f"mean strain <= {100 * STRAIN_LIMIT:g} % in every frame, no edge changed by more "
            "than 50 % at the end",
        ),
        Row(
            name=f"{name}.whole_at_end",
            value=_share(
                [a.strain_end is not None and a.strain_end <= STRAIN_LIMIT for a in attempts]
            ),
            unit="%",
            note="mean strain in the last frame alone",
        ),
        Row(
            name=f"{name}.strain_median",
            value=_over(dropped, lambda a: a.strain_worst, statistics.median, 100),
            unit="%",
            note="mean strain over the edges, in the worst frame of each garment",
        ),
        Row(
            name=f"{name}.strain_worst",
            value=_over(dropped, lambda a: a.strain_worst, max, 100),
            unit="%",
            bar=f"<= {100 * STRAIN_LIMIT:g}",
        ),
        Row(
            name=f"{name}.edge_change",
            value=_over(dropped, lambda a: a.edge_change, max, 100),
            unit="%",
            bar="<= 50",
            note="one edge of one garment, at the end",
        ),
        Row(
            name=f"{name}.at_rest",
            value=_share([a.still_seconds is not None for a in attempts]),
            unit="%",
            note="within the time simulated",
        ),
        Row(
            name=f"{name}.crossings",
            value=float(sum((a.crossings_end or 0) > 0 for a in dropped)),
            unit="",
            note="garments with an edge that pierces a triangle of another place at the end",
        ),
        Row(
            name=f"{name}.edges",
            value=_pool(built, lambda a: a.edge_share, lambda a: a.edges),
            unit="%",
            bar=">= 99",
            note="within 8 to 18 mm, of all edges",
        ),
        Row(
            name=f"{name}.edges_least",
            value=_over(built, lambda a: a.edge_share, min, 100),
            unit="%",
            note="of one garment",
        ),
        Row(
            name=f"{name}.angles",
            value=_pool(built, lambda a: a.angle_share, lambda a: a.faces),
            unit="%",
            bar=">= 99",
            note="smallest angle of at least 20 degrees, of all triangles",
        ),
        Row(
            name=f"{name}.angles_least",
            value=_over(built, lambda a: a.angle_share, min, 100),
            unit="%",
            note="of one garment",
        ),
        Row(
            name=f"{name}.particles",
            value=_share(is_sized),
            unit="%",
            bar=">= 100",
            note=f"garments of {low:,} to {high:,} particles",
        ),
        Row(
            name=f"{name}.particles_least", value=_over(built, lambda a: a.particles, min), unit=""
        ),
        Row(name=f"{name}.particles_most", value=_over(built, lambda a: a.particles, max), unit=""),
        Row(
            name=f"{name}.landmarks",
            value=_over(built, lambda a: a.landmark_miss, max),
            unit="edges",
            bar="<= 0.5",
            note="largest miss of a landmark that is mapped to another garment of the category",
        ),
        Row(
            name=f"{name}.build",
            value=_over(built, lambda a: a.build_seconds, statistics.median),
            unit="s",
            bar="<= 1",
            note="median CPU time of building a garment",
        ),
        Row(
            name=f"{name}.build_longest",
            value=_over(built, lambda a: a.build_seconds, max),
            unit="s",
        ),
        Row(
            name=f"{name}.drop",
            value=_over(dropped, lambda a: a.drop_seconds, statistics.fmean),
            unit="s",
            note="mean CPU time of dropping a garment",
        ),
    ]


def _share(flags: Sequence[bool]) -> float | None:
    return 100 * sum(flags) / len(flags) if flags else None


def _over(
    attempts: Sequence[Attempt],
    get: Callable[[Attempt], float | None],
    reduce: Callable[[list[float]], float],
    factor: float = 1.0,
) -> float | None:
    values = [float(value) for a in attempts if (value := get(a)) is not None]
    return factor * reduce(values) if values else None


def _pool(
    attempts: Sequence[Attempt],
    get: Callable[[Attempt], float | None],
    weigh: Callable[[Attempt], int],
) -> float | None:
    """Share of the edges or triangles of all garments [%]."""
    weight = sum(weigh(a) for a in attempts)
    return 100 * sum((get(a) or 0.0) * weigh(a) for a in attempts) / weight if weight else None
