"""Garments that several test modules look at; each is made once."""

import pytest

from dgl_assets import Garment, garment_ids, list_categories, load_garment


@pytest.fixture(scope="session")
def families() -> dict[str, list[Garment]]:
    """A few garments of each category, within reach and of all sizes."""
    return {
        category: [
            load_garment(garment_id)
            for sizes, count in (("reach", 2), ("all", 2))
            for garment_id in garment_ids(category, "test", sizes=sizes, count=count)
        ]
        for category in list_categories()
    }
