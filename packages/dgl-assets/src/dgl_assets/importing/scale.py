"""Find out how long a unit of a file is."""

from __future__ import annotations

import math

from dgl_assets.importing.categories import CATEGORIES
from dgl_assets.importing.errors import UnclearGarmentError

UNITS: dict[str, float] = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254}
"""Length of each unit that is considered [m]."""


def find_unit(
    longest: float,
    category: str,
    *,
    units: str | None,
    declared: float | None,
    trunk: float | None = None,
) -> tuple[float, str]:
    """Find the length of a unit.

    Args:
        longest: Longest extent of the garment, in units.
        category: What it is, for its plausible size.
        units: Name of the unit if the user says it, one of `UNITS`.
        declared: Length of a unit that the file states [m].
        trunk: Size of the garment without its sleeves, in units; see `measure_trunk`.

    Returns:
        Length of a unit [m], and how that was found out.

    Raises:
        ValueError: If `units` is unknown.
        UnclearGarmentError: If no unit gives a plausible size.
    """
    low, high = CATEGORIES[category].size
    if units is not None:
        if units not in UNITS:
            raise ValueError(f"units must be one of {sorted(UNITS)}; got {units!r}")
        return UNITS[units], f"unit {units}, as given"
    if declared is not None and low <= longest * declared <= high:
        return declared, f"unit {declared:g} m, as the file states"
    fitting = [name for name, unit in UNITS.items() if low <= longest * unit <= high]
    if not fitting:
        sizes = ", ".join(f"{longest * unit:.3g} m in {name}" for name, unit in UNITS.items())
        raise UnclearGarmentError(
            f"the unit is unclear: a {category} is {low:g} to {high:g} m long, this one {sizes}; "
            "give `units` or "
            "`category`"
        )
    usual, size = CATEGORIES[category].trunk, trunk
    if usual is None or size is None:
        usual, size = math.sqrt(low * high), longest
    # The nearest to the usual size, in proportion.
    name = min(fitting, key=lambda name: abs(math.log(size * UNITS[name] / usual)))
    text = f"unit {name}, assumed because {longest * UNITS[name]:.2f} m is the size of a {category}"
    if declared is not None:
        text += f" and {longest * declared:.3g} m, by the file's own unit, is not"
    others = [f"{longest * UNITS[other]:.2f} m in {other}" for other in fitting if other != name]
    if others:
        text += f"; it could be {' or '.join(others)}: give `units` if it is"
    return UNITS[name], text
