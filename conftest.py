"""What the tests of all packages share."""

import gc
import signal
from collections.abc import Iterator

import pytest


def pytest_collection_finish() -> None:
    """Keep what has been imported out of all collections of garbage; ManiSkill makes one in each reset."""
    gc.collect()
    gc.freeze()


@pytest.fixture
def heeds_interrupts() -> Iterator[None]:
    """Let this process, and those that it starts, heed SIGINT; a shell has its background jobs ignore it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)
