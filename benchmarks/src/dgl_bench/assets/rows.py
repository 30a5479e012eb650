"""Rows of a run: measures of all garments and of each category, beside their thresholds."""

import statistics
from collections.abc import Callable, Iterable, Sequence

from dgl_bench.assets.attempts import STRAIN_LIMIT, Attempt
from dgl_bench.rows import Reading

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


def make_rows(attempts: Sequence[Attempt]) -> list[Reading]:
    """Make the rows of all garments and, where there are several categories, of each."""
    rows = summarise("all", attempts)
    categories = group(attempts)
    for name, own in categories.items() if len(categories) > 1 else ():
        rows += summarise(name, own)
    return rows


def summarise(name: str, attempts: Sequence[Attempt]) -> list[Reading]:
    """Make the rows of some garments, each named after them and what was measured: `all.whole`."""
    built = [a for a in attempts if a.edge_share is not None]
    dropped = [a for a in built if not a.error]
    low, high = PARTICLE_RANGE
    is_sized = [low <= a.particles <= high for a in built]
    return [
        Reading(f"{name}.garments", float(len(attempts)), ""),
        Reading(
            f"{name}.errors",
            float(sum(bool(a.error) for a in attempts)),
            "",
            bar="<= 0",
            note="not built, diverged, not finite, or too many contacts",
        ),
        Reading(
            f"{name}.whole",
            _share([a.is_whole for a in attempts]),
            "%",
            bar=">= 100",
            note=f"mean strain <= {100 * STRAIN_LIMIT:g} % in every frame, no edge changed by more "
            "than 50 % at the end",
        ),
        Reading(
            f"{name}.whole_at_end",
            _share([a.strain_end is not None and a.strain_end <= STRAIN_LIMIT for a in attempts]),
            "%",
            note="mean strain in the last frame alone",
        ),
        Reading(
            f"{name}.strain_median",
            _over(dropped, lambda a: a.strain_worst, statistics.median, 100),
            "%",
            note="mean strain over the edges, in the worst frame of each garment",
        ),
        Reading(
            f"{name}.strain_worst",
            _over(dropped, lambda a: a.strain_worst, max, 100),
            "%",
            bar=f"<= {100 * STRAIN_LIMIT:g}",
        ),
        Reading(
            f"{name}.edge_change",
            _over(dropped, lambda a: a.edge_change, max, 100),
            "%",
            bar="<= 50",
            note="one edge of one garment, at the end",
        ),
        Reading(
            f"{name}.at_rest",
            _share([a.still_seconds is not None for a in attempts]),
            "%",
            note="within the time simulated",
        ),
        Reading(
            f"{name}.crossings",
            float(sum((a.crossings_end or 0) > 0 for a in dropped)),
            "",
            note="garments with an edge that pierces a triangle of another place at the end",
        ),
        Reading(
            f"{name}.edges",
            _pool(built, lambda a: a.edge_share, lambda a: a.edges),
            "%",
            bar=">= 99",
            note="within 8 to 18 mm, of all edges",
        ),
        Reading(
            f"{name}.edges_least",
            _over(built, lambda a: a.edge_share, min, 100),
            "%",
            note="of one garment",
        ),
        Reading(
            f"{name}.angles",
            _pool(built, lambda a: a.angle_share, lambda a: a.faces),
            "%",
            bar=">= 99",
            note="smallest angle of at least 20 degrees, of all triangles",
        ),
        Reading(
            f"{name}.angles_least",
            _over(built, lambda a: a.angle_share, min, 100),
            "%",
            note="of one garment",
        ),
        Reading(
            f"{name}.particles",
            _share(is_sized),
            "%",
            bar=">= 100",
            note=f"garments of {low:,} to {high:,} particles",
        ),
        Reading(f"{name}.particles_least", _over(built, lambda a: a.particles, min), ""),
        Reading(f"{name}.particles_most", _over(built, lambda a: a.particles, max), ""),
        Reading(
            f"{name}.landmarks",
            _over(built, lambda a: a.landmark_miss, max),
            "edges",
            bar="<= 0.5",
            note="largest miss of a landmark that is mapped to another garment of the category",
        ),
        Reading(
            f"{name}.build",
            _over(built, lambda a: a.build_seconds, statistics.median),
            "s",
            bar="<= 1",
            note="median CPU time of building a garment",
        ),
        Reading(f"{name}.build_longest", _over(built, lambda a: a.build_seconds, max), "s"),
        Reading(
            f"{name}.drop",
            _over(dropped, lambda a: a.drop_seconds, statistics.fmean),
            "s",
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
