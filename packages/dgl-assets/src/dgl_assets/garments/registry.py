"""The categories of garments, as data.

A family registers by one entry here: how to draw measures, how to make a garment of them, and how many there are.
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
    """One category of garments.

    Attributes:
        name: Such as "Tops_LongSleeve".
        title: What it holds, in words.
        sample: Draws measures from a generator, either within reach of the robots or of all sizes.
        make: Makes a garment: `make(measures, spacing=..., name=...)`.
        train_count: Garments for training, for each choice of sizes.
        test_count: Further garments for testing.
        paper_train: Garments that the paper collects with.
        paper_all: Garments that the paper evaluates on, which include those.
    """

    name: str
    title: str
    sample: Callable[[np.random.Generator, Sizes], Any]
    make: Callable[..., Garment]
    train_count: int = 8000
    test_count: int = 2000
    paper_train: int
    paper_all: int

    def __post_init__(self) -> None:
        if not 0 <= self.paper_train <= self.paper_all:
            raise ValueError(
                f"paper_train must be in [0, paper_all = {self.paper_all}]; got {self.paper_train}"
            )
        unseen = self.paper_all - self.paper_train
        if self.paper_train > self.train_count or unseen > self.test_count:
            raise ValueError(
                f"the paper's {self.paper_train} + {unseen} garments must fit into {self.train_count} "
                f"for training and {self.test_count} for testing"
            )


_CATEGORIES = (
    Category(
        name=tops.LONG_SLEEVE,
        title="long-sleeved tops",
        sample=lambda rng, sizes: sample_top(rng, sizes=sizes),
        make=tops.make_top,
        paper_train=100,
        paper_all=247,
    ),
    Category(
        name=tops.NO_SLEEVE,
        title="sleeveless tops",
        sample=lambda rng, sizes: sample_sleeveless_top(rng, sizes=sizes),
        make=tops.make_sleeveless_top,
        paper_train=100,
        paper_all=217,
    ),
    Category(
        name=tops.FRONT_OPEN,
        title="coats, jackets and cardigans",
        sample=lambda rng, sizes: sample_front_open_top(rng, sizes=sizes),
        make=tops.make_front_open_top,
        paper_train=40,
        paper_all=78,
    ),
    Category(
        name=dresses.CATEGORY,
        title="dresses, long and short, with long or short sleeves",
        sample=lambda rng, sizes: sample_dress(rng, sizes=sizes),
        make=dresses.make_dress,
        paper_train=26,
        paper_all=38,
    ),
    Category(
        name=trousers.CATEGORY,
        title="trousers and shorts",
        sample=lambda rng, sizes: sample_trousers(rng, sizes=sizes),
        make=trousers.make_trousers,
        paper_train=100,
        paper_all=317,
    ),
    Category(
        name=scarves.CATEGORY,
        title="scarves",
        sample=lambda rng, sizes: scarves.sample_scarf(rng),
        make=scarves.make_scarf,
        paper_train=8,
        paper_all=8,
    ),
    # Hats and gloves have one choice of sizes: any of them can be reached.
    Category(
        name=caps.CATEGORY,
        title="baseball caps",
        sample=lambda rng, sizes: sample_cap(rng),
        make=caps.make_cap,
        paper_train=12,
        paper_all=12,
    ),
    Category(
        name=bowl_hats.CATEGORY,
        title="hats with a brim all around",
        sample=lambda rng, sizes: sample_bowl_hat(rng),
        make=bowl_hats.make_bowl_hat,
        paper_train=8,
        paper_all=8,
    ),
    Category(
        name=gloves.CATEGORY,
        title="five-fingered gloves",
        sample=lambda rng, sizes: sample_glove(rng),
        make=gloves.make_glove,
        paper_train=0,
        paper_all=17,
    ),
)
CATEGORIES: dict[str, Category] = {category.name: category for category in _CATEGORIES}
"""The categories by name. The paper's counts are those of `Category.paper_train` and `paper_all`; its text has 18 dresses
in one place and 26 in another, and the lists of its code have 245 long-sleeved tops."""


def get_category(name: str) -> Category:
    """Look up a category.

    Raises:
        AssetNotFoundError: If it does not exist; the message lists those that do.
    """
    if name not in CATEGORIES:
        raise AssetNotFoundError(f"unknown category {name!r}; expected one of {sorted(CATEGORIES)}")
    return CATEGORIES[name]
