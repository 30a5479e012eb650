"""Readers that behave and misbehave, for the tests of the guard."""

import os
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np


class DamagedError(Exception):
    """Of the same name as the one of the tests."""


def echo(*arguments):
    array = np.arange(6, dtype=np.int16).reshape(2, 3)
    os.write(1, b"a library that prints\n")
    return {
        "arguments": arguments,
        "parts": [{"array": array}],
        "bytes": b"\0\1",
        "nothing": None,
        "process": os.getpid(),
    }


def sleep():
    time.sleep(30)


def compute():
    while True:
        pass


def fill_memory():
    return np.ones(2**30)


def abort():
    os.abort()


def leave():
    os._exit(3)


def fail():
    raise ValueError("two\nlines")


def refuse():
    raise DamagedError("line 7")


def return_an_object():
    return {"value": object()}


def return_pickled():
    return {"value": np.array([object()])}


@dataclass(frozen=True)
class Part:
    name: str
    array: np.ndarray
    near: tuple[float, float] | None = None
    files: tuple[Path, ...] = ()


@dataclass(frozen=True)
class Whole:
    parts: tuple[Part, ...]
    first: Part | None = None


def make_whole():
    return Whole(
        parts=(Part("a", np.arange(3), (1.0, 2.0)), Part("b", np.eye(2), None, (Path("x"),)))
    )
