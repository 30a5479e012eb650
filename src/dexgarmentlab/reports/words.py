"""Names and units of measurements and random draws on pages."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

__all__ = ["DRAWN", "MEASURED", "Words", "find_words"]


@dataclass(frozen=True)
class Words:
    """Name and unit of a value that files have under a short name."""

    text: str
    """Name on the page."""
    unit: str = ""
    """Unit on the page."""
    factor: float = 1.0
    """Converts it from the unit that files have."""


MEASURED: Mapping[str, Words] = {
    "max_strain_mean": Words("largest mean strain of the edges", "%", 100.0),
    "max_strain_p999": Words("strain that 99.9 % of the edges stay below", "%", 100.0),
    "max_penetration_m": Words("deepest penetration", "mm", 1000.0),
    "placement_error_m": Words("horizontal distance from its place at the end", "cm", 100.0),
    "steps": Words("control steps"),
    "further_tries": Words("retries of a stage"),
    "further_rounds": Words("retries from the first stage"),
}
"""Measurements of an attempt; see `dgl_tasks.driver` and `dgl_collect.results`."""

FORCE_ON = "max_force_on_"
"""Start of the names of forces on objects that are avoided."""

DRAWN: Mapping[str, Words] = {
    "x": Words("garment, x", "m"),
    "y": Words("garment, y", "m"),
    "roll": Words("garment, tilt when dropped", "°", float(np.degrees(1.0))),
}
"""Draws of an episode; those of objects are named after them, such as "hanger_x"."""


def find_words(name: str, known: Mapping[str, Words]) -> Words:
    """Find what a value is called; one that is not known keeps its name, without underscores."""
    if name in known:
        return known[name]
    if name.startswith(FORCE_ON) and name.endswith("_N"):
        touched = name.removeprefix(FORCE_ON).removesuffix("_N").replace("_", " ")
        return Words(f"largest force on the {touched}", "N")
    owner, _, axis = name.rpartition("_")
    if owner and axis in ("x", "y"):
        return Words(f"{owner.replace('_', ' ')}, {axis}", "m")
    return Words(name.replace("_", " "))
