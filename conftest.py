"""Fixtures and hooks shared by the tests of all packages."""

import copy
import gc
import os
import signal
import statistics
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

collect_ignore = ["packages/lerobot_env_dexgarmentlab"]  # it has an environment of its own
_SHOWN = 20
_costs: list[tuple[float, str]] = []
"""Processor time [s] of each test of this process, its fixtures and child processes included."""
_total = 0.0
"""Processor time of xdist's workers that have ended [s]."""
_slowness: list[float] = []
"""Duration of a fixed computation [s]: of this process at its start and end, and of the workers."""
_REFERENCE = 0.055
"""Its duration [s] on the machine that the limit is for."""


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add `--processor-limit`."""
    parser.addoption(
        "--processor-limit",
        type=float,
        metavar="MINUTES",
        help="print the processor time of all tests and the longest ones; fail above so many "
        "minutes of the reference machine",
    )


def pytest_collection_finish() -> None:
    """Exclude imported objects from garbage collection; ManiSkill collects in each reset."""
    gc.collect()
    gc.freeze()
    _slowness.append(_calibrate())


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Iterator[None]:
    """Note the processor time of each test."""
    began = _measure_seconds()
    found = yield
    _costs.append((_measure_seconds() - began, item.nodeid))
    return found


@pytest.hookimpl(optionalhook=True)
def pytest_testnodedown(node: object) -> None:
    """Take over the processor time of a worker that ends."""
    global _total  # noqa: PLW0603
    output = getattr(node, "workeroutput", {})
    _total += output.get("seconds", 0.0)
    _costs.extend(map(tuple, output.get("costs", ())))
    _slowness.extend(output.get("slowness", ()))


def pytest_sessionfinish(session: pytest.Session) -> None:
    """Tell the controller the processor time; fail where it is above the limit."""
    if hasattr(session.config, "workeroutput"):
        longest = sorted(_costs, reverse=True)[:_SHOWN]
        session.config.workeroutput |= {
            "seconds": _measure_seconds(),
            "costs": longest,
            "slowness": [*_slowness, _calibrate()],
        }
        return
    limit = session.config.getoption("--processor-limit")
    if (
        limit is not None
        and session.exitstatus == 0
        and _measure_all() / _find_factor() > 60 * limit
    ):
        session.exitstatus = pytest.ExitCode.TESTS_FAILED


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Print the processor time of all tests, and of the longest."""
    limit = terminalreporter.config.getoption("--processor-limit")
    if limit is None:
        return
    terminalreporter.section(f"the {_SHOWN} longest tests, by processor time")
    for seconds, name in sorted(_costs, reverse=True)[:_SHOWN]:
        terminalreporter.line(f"{seconds:6.2f} s  {name}")
    minutes, factor = _measure_all() / 60, _find_factor()
    terminalreporter.line(
        f"processor time of all tests: {minutes:.1f} min, {minutes / factor:.1f} min on the "
        f"reference machine, which is {factor:.1f} times as fast; limit {limit:g} min"
    )


def _find_factor() -> float:
    """Tell how many times as fast as this machine the reference machine is."""
    return statistics.median(_slowness) / _REFERENCE


def _calibrate() -> float:
    """Measure the processor time of a fixed computation [s]."""
    began = time.process_time()
    total = 0
    for number in range(1_000_000):
        total += number * number
    return time.process_time() - began


def _measure_all() -> float:
    """Processor time of the controller and of the workers that have ended [s]."""
    if not _total:
        return _measure_seconds()
    times = os.times()  # without children: they are the workers
    return _total + times.user + times.system


def _measure_seconds() -> float:
    """Processor time of this process and of its children that have ended [s]."""
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system


_garments: dict[tuple[object, ...], object] = {}
"""Garments of the catalogue that this process has made."""


@pytest.fixture(scope="module", autouse=True)
def garments_made_once() -> Iterator[None]:
    """Give tests copies of a garment of the catalogue, which each process makes once.

    A module that is about making them overrides it.
    """
    catalogue = sys.modules.get("dgl_assets.garments.catalogue")
    if catalogue is None:
        yield
        return
    make = catalogue._make

    def make_once(entry: object, number: int, name: str, *, spacing: float | None) -> object:
        key = (name, spacing)
        if key not in _garments:
            _garments[key] = make(entry, number, name, spacing=spacing)
        return copy.deepcopy(_garments[key])

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(catalogue, "_make", make_once)
        yield


@pytest.fixture(scope="module")
def coarse_garments() -> Iterator[None]:
    """Give environments garments of a fifth of the particles, which settle five times as fast."""
    from dgl_assets import load_garment
    from dgl_assets.importing import find_garment

    def find(source: object) -> object:
        if isinstance(source, str) and not Path(source).exists():
            return load_garment(source, spacing=0.025)
        return find_garment(source)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("dgl_tasks.task_garment.find_garment", find)
        yield


@pytest.fixture
def fine_garments(monkeypatch: pytest.MonkeyPatch) -> None:
    """Give environments all particles of a garment, in a module of coarse ones."""
    from dgl_assets.importing import find_garment

    monkeypatch.setattr("dgl_tasks.task_garment.find_garment", find_garment)


@pytest.fixture
def heeds_interrupts() -> Iterator[None]:
    """Let this process and its children heed SIGINT, which shells have background jobs ignore."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)
