"""Garments and people that several test modules look at; each is made once."""

import re
from collections.abc import Callable, Iterable

import pytest

from dgl_assets import Garment, garment_ids, list_categories, load_garment
from dgl_assets.people import Person, make_person


class Families(dict[str, list[Garment]]):
    """Garments within reach and of all sizes by category, made when they are asked for."""

    def __init__(self, count: int) -> None:
        super().__init__({category: [] for category in list_categories()})
        self._count = count

    def __getitem__(self, category: str) -> list[Garment]:
        if not super().__getitem__(category):
            self[category] = [
                load_garment(garment_id)
                for sizes in ("reach", "all")
                for garment_id in garment_ids(category, "test", sizes=sizes, count=self._count)
            ]
        return super().__getitem__(category)


@pytest.fixture(
    scope="session", params=[1, pytest.param(3, marks=pytest.mark.slow)], ids=["two", "six"]
)
def families(request) -> Families:
    """Two garments of each category; six in slow tests."""
    return Families(request.param)


@pytest.fixture(scope="session")
def woman() -> Person:
    """A woman at the size of the garments."""
    return make_person("woman", scale=0.85)


@pytest.fixture(scope="session")
def find_unrefused() -> Callable[[Iterable[tuple[Callable[[], object], str]]], list[str]]:
    """Find the rows of a table (call, pattern) that raise no ValueError of that pattern."""

    def find(rows: Iterable[tuple[Callable[[], object], str]]) -> list[str]:
        found = []
        for call, pattern in rows:
            try:
                call()
            except ValueError as err:
                if not re.search(pattern, str(err)):
                    found.append(f"{pattern}: {err}")
            else:
                found.append(f"{pattern}: accepted")
        return found

    return find
