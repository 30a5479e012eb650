"""The categories of garments.

A family is added by one entry: its measures, how they are drawn and made, and the number of
garments.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from dgl_assets.errors import AssetNotFoundError
from dgl_assets.garments.assembly import Cut, assemble
from dgl_assets.garments.drawing import draw_until_valid
from dgl_assets.garments.dresses import garment as dresses
from dgl_assets.garments.dresses.parameters import DressParameters
from dgl_assets.garments.dresses.sampling import draw_dress
from dgl_assets.garments.garment import Garment
from dgl_assets.garments.gloves import glove as gloves
from dgl_assets.garments.gloves.parameters import GloveParameters
from dgl_assets.garments.gloves.sampling import draw_glove
from dgl_assets.garments.hats import bowl as bowl_hats
from dgl_assets.garments.hats import cap as caps
from dgl_assets.garments.hats.bowl_parameters import BowlHatParameters
from dgl_assets.garments.hats.bowl_sampling import draw_bowl_hat
from dgl_assets.garments.hats.cap_parameters import CapParameters
from dgl_assets.garments.hats.cap_sampling import draw_cap
from dgl_assets.garments.scarves import garment as scarves
from dgl_assets.garments.sizes import Sizes
from dgl_assets.garments.tops import garment as tops
from dgl_assets.garments.tops.parameters import (
    FrontOpenParameters,
    SleevelessParameters,
    TopParameters,
)
from dgl_assets.garments.tops.sampling import draw_front_open_top, draw_sleeveless_top, draw_top
from dgl_assets.garments.trousers import garment as trousers
from dgl_assets.garments.trousers.parameters import TrousersParameters
from dgl_assets.garments.trousers.sampling import draw_trousers
from dgl_assets.garments.uppers.cutting import Pins, cut_upper
from dgl_assets.ranges import check_choice, check_range


@dataclass(frozen=True, kw_only=True)
class Category:
    """One category of garments."""

    name: str
    """Such as "Tops_LongSleeve"."""
    title: str
    """Content in words."""
    measures: type
    """Dataclass of its measures."""
    draw: Callable[[np.random.Generator, Sizes], Any]
    """Draws measures, within reach of the robots or of all sizes; those that do not fit together
    are a ValueError."""
    make: Callable[..., Garment]
    """Makes a garment: `make(measures, spacing=..., name=...)`."""
    spacing: float | None = None
    """Default edge length [m]; None for 13 mm, adapted to the size."""
    spacings: tuple[float, float] = (0.006, 0.025)
    """Range of edge lengths [m]."""
    train_count: int = 8000
    """Garments for training, for each choice of sizes."""
    test_count: int = 2000
    """Further garments for testing."""
    paper_train: int
    """Garments that the paper collects with."""
    paper_all: int
    """Garments that the paper evaluates on, `paper_train` included."""

    def __post_init__(self) -> None:
        if not 0 <= self.paper_train <= self.paper_all:
            raise ValueError(
                f"paper_train must be in [0, paper_all = {self.paper_all}]; got {self.paper_train}"
            )
        unseen = self.paper_all - self.paper_train
        if self.paper_train > self.train_count or unseen > self.test_count:
            raise ValueError(
                f"the paper's {self.paper_train} + {unseen} garments must fit into "
                f"{self.train_count} for training and {self.test_count} for testing"
            )


def _sew(category: str, cut: Callable[[Any], Cut]) -> Callable[..., Garment]:
    """Make garments of a category of cloth."""
    return lambda measures, **options: assemble(cut(measures), category, measures, **options)


def _sew_upper(category: str, pins: Pins) -> Callable[..., Garment]:
    """Make garments for the upper body, with landmarks at these places."""
    return _sew(category, lambda measures: cut_upper(measures.cuts, pins))


_CATEGORIES = (
    Category(
        name=tops.LONG_SLEEVE, title="long-sleeved tops",
        measures=TopParameters, draw=draw_top, make=_sew_upper(tops.LONG_SLEEVE, tops.TOP_PINS),
        paper_train=100, paper_all=247,
    ),
    Category(
        name=tops.NO_SLEEVE, title="sleeveless tops",
        measures=SleevelessParameters, draw=draw_sleeveless_top,
        make=_sew_upper(tops.NO_SLEEVE, tops.SLEEVELESS_PINS), paper_train=100, paper_all=217,
    ),
    Category(
        name=tops.FRONT_OPEN, title="coats, jackets and cardigans",
        measures=FrontOpenParameters, draw=draw_front_open_top,
        make=_sew_upper(tops.FRONT_OPEN, tops.FRONT_OPEN_PINS), paper_train=40, paper_all=78,
    ),
    Category(
        name=dresses.CATEGORY, title="dresses, long and short, with long or short sleeves",
        measures=DressParameters, draw=draw_dress,
        make=_sew_upper(dresses.CATEGORY, dresses.DRESS_PINS), paper_train=26, paper_all=38,
    ),
    Category(
        name=trousers.CATEGORY, title="trousers and shorts",
        measures=TrousersParameters, draw=draw_trousers,
        make=_sew(trousers.CATEGORY, trousers.cut_trousers), paper_train=100, paper_all=317,
    ),
    Category(
        name=scarves.CATEGORY, title="scarves",
        measures=scarves.ScarfParameters, draw=scarves.draw_scarf,
        make=_sew(scarves.CATEGORY, scarves.cut_scarf), paper_train=8, paper_all=8,
    ),
    Category(
        name=caps.CATEGORY, title="baseball caps",
        measures=CapParameters, draw=draw_cap, make=caps.make_cap,
        spacing=caps.SPACING, spacings=(0.006, 0.016), paper_train=12, paper_all=12,
    ),
    Category(
        name=bowl_hats.CATEGORY, title="hats with a brim all around",
        measures=BowlHatParameters, draw=draw_bowl_hat, make=bowl_hats.make_bowl_hat,
        spacing=bowl_hats.SPACING, spacings=(0.006, 0.016), paper_train=8, paper_all=8,
    ),
    Category(
        name=gloves.CATEGORY, title="five-fingered gloves",
        measures=GloveParameters, draw=draw_glove, make=gloves.make_glove,
        spacing=gloves.SPACING, spacings=(0.005, 0.014), paper_train=0, paper_all=17,
    ),
)  # fmt: skip
CATEGORIES: dict[str, Category] = {category.name: category for category in _CATEGORIES}
"""The categories by name. The paper's text has 18 dresses in one place and 26 in another; the lists
of its code have 245 long-sleeved tops."""


def get_category(name: str) -> Category:
    """Look up a category.

    Raises:
        AssetNotFoundError: If it does not exist; the message lists those that do.
    """
    if name not in CATEGORIES:
        raise AssetNotFoundError(f"unknown category {name!r}; expected one of {sorted(CATEGORIES)}")
    return CATEGORIES[name]


def sample_measures(
    category: str, rng: np.random.Generator | int, *, sizes: Sizes = "reach"
) -> Any:
    """Draw measures of a random garment, as a shop would mix them.

    Args:
        category: One of `list_categories()`.
        rng: Generator, advanced by this call, or a seed.
        sizes: "reach" for garments that both robots reach, "all" for children to XXL.

    Returns:
        The measures, such as `TopParameters`, for `make_garment`.

    Raises:
        AssetNotFoundError: If the category does not exist.
        ValueError: If `sizes` does not exist.
    """
    entry = get_category(category)
    check_choice("sizes", sizes, ("reach", "all"))
    return draw_until_valid(rng, lambda r: entry.draw(r, sizes))


def make_garment(measures: Any, *, spacing: float | None = None, name: str = "garment") -> Garment:
    """Make a garment.

    Args:
        measures: Measures of a category, such as `TopParameters`.
        spacing: Target edge length [m]: 0.006 to 0.025 of cloth, to 0.016 of hats, 0.005 to 0.014
            of gloves; by default the category's own, for cloth 13 mm, adapted to the size.
        name: Name of the garment.

    Raises:
        ValueError: If the measures contradict each other, are of no category, or spacing is out of
            range.
        MeshingError: If it cannot be meshed at this spacing.
    """
    entry = next((c for c in CATEGORIES.values() if c.measures is type(measures)), None)
    if entry is None:
        raise ValueError(f"measures must be those of a category; got {measures!r}")
    spacing = entry.spacing if spacing is None else spacing
    if spacing is not None:
        check_range("spacing", spacing, *entry.spacings)
    return entry.make(measures, spacing=spacing, name=name)
