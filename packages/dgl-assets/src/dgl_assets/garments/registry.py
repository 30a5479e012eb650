"""The categories of garments.

A family is added by one entry: its sampler of measures, its maker, and the number of garments.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from dgl_assets.errors import AssetNotFoundError
from dgl_assets.garments.dresses import garment as dresses
from dgl_assets.garments.dresses.sampling import sample_dress
from dgl_assets.garments.garment import Garment
from dgl_assets.garments.gloves import glove as gloves
from dgl_assets.garments.gloves.sampling import sample_glove
from dgl_assets.garments.hats import bowl as bowl_hats
from dgl_assets.garments.hats import cap as caps
from dgl_assets.garments.hats.bowl_sampling import sample_bowl_hat
from dgl_assets.garments.hats.cap_sampling import sample_cap
from dgl_assets.garments.scarves import garment as scarves
from dgl_assets.garments.sizes import Sizes
from dgl_assets.garments.tops import garment as tops
from dgl_assets.garments.tops.sampling import (
    sample_front_open_top,
    sample_sleeveless_top,
    sample_top,
)
from dgl_assets.garments.trousers import garment as trousers
from dgl_assets.garments.trousers.sampling import sample_trousers


@dataclass(frozen=True, kw_only=True)
class Category:
    """One category of garments."""

    name: str
    """Such as "Tops_LongSleeve"."""
    title: str
    """Content in words."""
    sample: Callable[[np.random.Generator, Sizes], Any]
    """Draws measures, either within reach of the robots or of all sizes."""
    make: Callable[..., Garment]
    """Makes a garment: `make(measures, spacing=..., name=...)`."""
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


_CATEGORIES = (
    Category(
        name=tops.LONG_SLEEVE, title="long-sleeved tops", make=tops.make_top,
        sample=lambda rng, sizes: sample_top(rng, sizes=sizes), paper_train=100, paper_all=247,
    ),
    Category(
        name=tops.NO_SLEEVE, title="sleeveless tops", make=tops.make_sleeveless_top,
        sample=lambda rng, sizes: sample_sleeveless_top(rng, sizes=sizes),
        paper_train=100, paper_all=217,
    ),
    Category(
        name=tops.FRONT_OPEN, title="coats, jackets and cardigans", make=tops.make_front_open_top,
        sample=lambda rng, sizes: sample_front_open_top(rng, sizes=sizes),
        paper_train=40, paper_all=78,
    ),
    Category(
        name=dresses.CATEGORY, title="dresses, long and short, with long or short sleeves",
        make=dresses.make_dress, sample=lambda rng, sizes: sample_dress(rng, sizes=sizes),
        paper_train=26, paper_all=38,
    ),
    Category(
        name=trousers.CATEGORY, title="trousers and shorts", make=trousers.make_trousers,
        sample=lambda rng, sizes: sample_trousers(rng, sizes=sizes), paper_train=100, paper_all=317,
    ),
    # Robots reach all sizes of scarves, hats and gloves.
    Category(
        name=scarves.CATEGORY, title="scarves", make=scarves.make_scarf,
        sample=lambda rng, _: scarves.sample_scarf(rng), paper_train=8, paper_all=8,
    ),
    Category(
        name=caps.CATEGORY, title="baseball caps", make=caps.make_cap,
        sample=lambda rng, _: sample_cap(rng), paper_train=12, paper_all=12,
    ),
    Category(
        name=bowl_hats.CATEGORY, title="hats with a brim all around", make=bowl_hats.make_bowl_hat,
        sample=lambda rng, _: sample_bowl_hat(rng), paper_train=8, paper_all=8,
    ),
    Category(
        name=gloves.CATEGORY, title="five-fingered gloves", make=gloves.make_glove,
        sample=lambda rng, _: sample_glove(rng), paper_train=0, paper_all=17,
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
