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
    percent = f"{100 * STRAIN_LIMIT:g}"
    is_held = [a.strain_end is not None and a.strain_end <= STRAIN_LIMIT for a in attempts]
    median, mean = statistics.median, statistics.fmean
    measures = [
        ("garments", len(attempts), "", "", ""),
        ("errors", sum(bool(a.error) for a in attempts), "", "<= 0",
         "not built, diverged, not finite, or too many contacts"),
        ("whole", _share([a.is_whole for a in attempts]), "%", ">= 100",
         f"mean strain <= {percent} % in every frame, no edge changed by over 50 % at the end"),
        ("whole_at_end", _share(is_held), "%", "", "mean strain in the last frame alone"),
        ("strain_median", _over(dropped, "strain_worst", median, 100), "%", "",
         "mean strain over the edges, in the worst frame of each garment"),
        ("strain_worst", _over(dropped, "strain_worst", max, 100), "%", f"<= {percent}", ""),
        ("edge_change", _over(dropped, "edge_change", max, 100), "%", "<= 50",
         "one edge of one garment, at the end"),
        ("at_rest", _share([a.still_seconds is not None for a in attempts]), "%", "",
         "within the time simulated"),
        ("crossings", sum((a.crossings_end or 0) > 0 for a in dropped), "", "",
         "garments with an edge that pierces a triangle of another place at the end"),
        ("edges", _pool(built, "edge_share", "edges"), "%", ">= 99",
         "within 8 to 18 mm, of all edges"),
        ("edges_least", _over(built, "edge_share", min, 100), "%", "", "of one garment"),
        ("angles", _pool(built, "angle_share", "faces"), "%", ">= 99",
         "smallest angle of at least 20 degrees, of all triangles"),
        ("angles_least", _over(built, "angle_share", min, 100), "%", "", "of one garment"),
        ("particles", _share([low <= a.particles <= high for a in built]), "%", ">= 100",
         f"garments of {low:,} to {high:,} particles"),
        ("particles_least", _over(built, "particles", min), "", "", ""),
        ("particles_most", _over(built, "particles", max), "", "", ""),
        ("landmarks", _over(built, "landmark_miss", max), "edges", "<= 0.5",
         "largest miss of a landmark that is mapped to another garment of the category"),
        ("build", _over(built, "build_seconds", median), "s", "<= 1",
         "median CPU time of building a garment"),
        ("build_longest", _over(built, "build_seconds", max), "s", "", ""),
        ("drop", _over(dropped, "drop_seconds", mean), "s", "",
         "mean CPU time of dropping a garment"),
    ]  # fmt: skip
    return [
        Reading(f"{name}.{m}", None if v is None else float(v), unit, bar=bar, note=note)
        for m, v, unit, bar, note in measures
    ]


def _share(flags: Sequence[bool]) -> float | None:
    return 100 * sum(flags) / len(flags) if flags else None


def _over(
    attempts: Sequence[Attempt],
    field: str,
    reduce: Callable[[list[float]], float],
    factor: float = 1.0,
) -> float | None:
    values = [float(v) for a in attempts if (v := getattr(a, field)) is not None]
    return factor * reduce(values) if values else None


def _pool(attempts: Sequence[Attempt], field: str, weight: str) -> float | None:
    """Share of the edges or triangles of all garments [%]."""
    weights = [getattr(a, weight) for a in attempts]
    total = sum((getattr(a, field) or 0.0) * w for a, w in zip(attempts, weights, strict=True))
    return 100 * total / sum(weights) if sum(weights) else None
