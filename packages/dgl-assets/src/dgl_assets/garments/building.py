"""Build many garments of the catalogue at once into a cache."""

from __future__ import annotations

import multiprocessing
import signal
import time
from collections.abc import Generator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path

from dgl_assets.garments.cache import find_cached
from dgl_assets.garments.catalogue import check_id, load_garment


@dataclass(frozen=True, kw_only=True)
class BuiltGarment:
    """One garment of a build."""

    id: str
    vertex_count: int
    """Number of vertices; 0 if it failed."""
    seconds: float
    """CPU time of building or reading [s]."""
    is_cached: bool = False
    """It was in the cache already."""
    error: str | None = None
    """Reason of a failure."""


def build_garments(
    garment_ids: Sequence[str], cache: Path, *, workers: int = 1
) -> Generator[BuiltGarment, None, None]:
    """Build garments into a cache that `load_garment` reads, and check existing ones.

    Every file appears whole, so an interrupted build is continued by calling this again.

    Args:
        garment_ids: Ids of the catalogue.
        cache: Folder of the cache; made if it does not exist.
        workers: Number of processes; 1 for the calling one alone.

    Yields:
        One entry per garment, as it is finished. Closing the generator ends the build.

    Raises:
        AssetNotFoundError: If an id does not exist, before anything is built.
        ValueError: If `workers` is not positive.
    """
    if workers < 1:
        raise ValueError(f"workers must be at least 1; got {workers}")
    for garment_id in garment_ids:
        check_id(garment_id)
    return _build(tuple(garment_ids), Path(cache), workers)


def _build(ids: tuple[str, ...], cache: Path, workers: int) -> Generator[BuiltGarment, None, None]:
    if workers == 1:
        for garment_id in ids:
            yield _build_one(garment_id, cache)
        return
    # A fresh process inherits no locks of threads that the caller may run.
    context = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(
        max_workers=workers, mp_context=context, initializer=_leave_interrupts
    )
    try:
        pending: list[Future[BuiltGarment]] = [pool.submit(_build_one, i, cache) for i in ids]
        for future in as_completed(pending):
            yield future.result()
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def _leave_interrupts() -> None:
    # Ctrl-C reaches every process of a terminal; the one that started the workers ends them.
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _build_one(garment_id: str, cache: Path) -> BuiltGarment:
    start = time.process_time()
    try:
        garment = find_cached(cache, garment_id)
        is_cached = garment is not None
        if garment is None:
            garment = load_garment(garment_id, cache=cache)
    except Exception as err:  # a process boundary: one bad garment must not end the build
        seconds, text = time.process_time() - start, f"{type(err).__name__}: {err}"
        return BuiltGarment(id=garment_id, vertex_count=0, seconds=seconds, error=text)
    count, seconds = len(garment.vertices), time.process_time() - start
    return BuiltGarment(id=garment_id, vertex_count=count, seconds=seconds, is_cached=is_cached)
