"""Garments and people of several test modules, each made once; reading without child processes."""

import re
from collections.abc import Callable, Iterable, Iterator, Mapping

import pytest

from dgl_assets import Garment, garment_ids, list_categories, load_garment
from dgl_assets.people import Person, make_person
from dgl_files import guard

_read_guarded = guard.read_guarded


class Families(Mapping[str, list[Garment]]):
    """Garments within reach and of all sizes by category, made when they are asked for."""

    def __init__(self, count: int) -> None:
        self._count = count
        self._made: dict[str, list[Garment]] = {}

    def __iter__(self) -> Iterator[str]:
        return iter(list_categories())

    def __len__(self) -> int:
        return len(list_categories())

    def __getitem__(self, category: str) -> list[Garment]:
        if category not in self._made:
            self._made[category] = [
                load_garment(garment_id)
                for sizes in ("reach", "all")
                for garment_id in garment_ids(category, "test", sizes=sizes, count=self._count)
            ]
        return self._made[category]


@pytest.fixture(scope="session")
def pairs() -> Families:
    """Two garments of each category."""
    return Families(1)


@pytest.fixture(
    scope="session", params=[False, pytest.param(True, marks=pytest.mark.slow)], ids=["two", "six"]
)
def families(request, pairs) -> Families:
    """Two garments of each category; six in slow tests."""
    return Families(3) if request.param else pairs


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


def _read_here(reader, *arguments, file, errors=(), **limits):
    """Do what the guard does, without a child process, where the reader cannot crash."""
    if any(str(argument).startswith("usd") for argument in arguments):
        return _read_guarded(reader, *arguments, file=file, errors=errors, **limits)
    try:
        return reader(*arguments)
    except errors:
        raise
    except Exception as err:
        text = " ".join(str(err).split())[:300]
        raise guard.GuardError(f"{file} cannot be read ({type(err).__name__}: {text})") from err


@pytest.fixture
def reads_here(monkeypatch):
    """Read files in this process: quicker, for tests of very many files."""
    monkeypatch.setattr(guard, "read_guarded", _read_here)


@pytest.fixture
def rest_poses(monkeypatch):
    """Give imported hands their joints at rest for each pose, which saves two seconds a hand."""
    from dgl_assets.robots.importing import importer

    def take_over_poses(tree, frame):
        return {name: importer.rest_positions(tree) for name in importer.POSE_NAMES}

    monkeypatch.setattr(importer, "take_over_poses", take_over_poses)
