"""Processor time of a program's parts, each without the parts that run inside of it."""

import functools
import importlib
import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from typing import Any

__all__ = ["Stopwatch", "find_owner", "watch_functions"]


class Stopwatch:
    """Charges every moment to the innermost part that runs.

    So the parts of a block add up to the block: what is inside of none belongs to the part around
    all of them.
    """

    def __init__(self, clock: Callable[[], float] = time.process_time) -> None:
        """Begin with nothing.

        Args:
            clock: Tells the time [s]; the processor time of all threads of this process by default.
        """
        self.seconds: defaultdict[str, float] = defaultdict(float)
        """Time of each part so far [s]."""
        self.first: dict[str, tuple[float, float]] = {}
        """Time of each part's first call: by the clock [s], and in seconds since 1970."""
        self._clock = clock
        self._running: list[str] = []
        self._since = 0.0

    @contextmanager
    def part(self, name: str) -> Iterator[None]:
        """Charge what runs inside to a part."""
        self._charge()
        if name not in self.first:
            self.first[name] = self._since, time.time()
        self._running.append(name)
        try:
            yield
        finally:
            self._charge()
            self._running.pop()

    def wrap(self, function: Callable[..., Any], name: str) -> Callable[..., Any]:
        """Give a function that charges its calls to a part."""

        @functools.wraps(function)
        def timed(*args: Any, **kwargs: Any) -> Any:
            with self.part(name):
                return function(*args, **kwargs)

        return timed

    def _charge(self) -> None:
        now = self._clock()
        if self._running:
            self.seconds[self._running[-1]] += now - self._since
        self._since = now


@contextmanager
def watch_functions(watch: Stopwatch, parts: Mapping[str, Sequence[str]]) -> Iterator[None]:
    """Charge the calls of functions to parts while the block runs; nothing is changed after it.

    Args:
        watch: Takes the times.
        parts: Functions of each part, "module:name" or "module:Class.name". A function of a module
            is timed where it is looked up in this module by its name.

    Raises:
        AttributeError: If there is no such function.
    """
    with ExitStack() as stack:
        for part, paths in parts.items():
            for path in paths:
                owner, name = find_owner(path)
                before = getattr(owner, name)
                if name in vars(owner):
                    stack.callback(setattr, owner, name, before)
                else:  # a method that was inherited is inherited again
                    stack.callback(delattr, owner, name)
                setattr(owner, name, watch.wrap(before, part))
        yield


def find_owner(path: str) -> tuple[Any, str]:
    """Find the module or class that holds a function, and the function's name there."""
    module, _, names = path.partition(":")
    *outer, name = names.split(".")
    owner = functools.reduce(getattr, outer, importlib.import_module(module))
    if not callable(getattr(owner, name)):
        raise AttributeError(f"path must name a function; got {path!r}")
    return owner, name
