"""A reader in a child process: its result comes back whole, and its failure is one line."""

import os
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from dgl_files.guard import GuardError, read_guarded

sys.path.append(str(Path(__file__).parent))  # so that the child finds the readers, too
import guarded_readers as readers


class DamagedError(Exception):
    """Stands for a package's own error."""


def test_values_arrays_and_bytes_come_back_as_they_are():
    array = np.arange(6, dtype=np.int16).reshape(2, 3)
    result = read_guarded(readers.echo, 3, "衬衫 \udcff", file="a.obj")
    assert result["arguments"] == [3, "衬衫 \udcff"]
    np.testing.assert_array_equal(result["parts"][0]["array"], array)
    assert result["parts"][0]["array"].dtype == np.int16
    assert result["bytes"] == b"\0\1"
    assert result["nothing"] is None
    assert result["process"] != os.getpid()


def test_dataclasses_tuples_and_paths_are_made_again():
    whole = read_guarded(readers.make_whole, file="a.obj", returns=readers.Whole)
    first, second = whole.parts
    assert (first.name, first.near, first.files, whole.first) == ("a", (1.0, 2.0), (), None)
    assert first.array.tolist() == [0, 1, 2]
    assert (second.near, second.files) == (None, (Path("x"),))


def test_what_goes_wrong_is_one_line_that_names_the_file():
    expected = {
        "sleep": "a.obj takes more than 0.2 s to read",
        "compute": "a.obj takes more than 1 s to read",
        "fill_memory": "a.obj takes more than 1 GB of memory to read",
        "abort": "a.obj makes its reader crash (SIGABRT)",
        "leave": "a.obj makes its reader crash (exit code 3)",
        "fail": "a.obj cannot be read (ValueError: two lines)",
        "return_an_object": "a.obj cannot be read (TypeError: Object of type object",
    }
    wrong = {}
    for name, text in expected.items():
        limit = {"sleep": 0.2, "compute": 1.0}.get(name, 60.0)
        with pytest.raises(GuardError) as caught:
            read_guarded(getattr(readers, name), file="a.obj", seconds=limit, gigabytes=1.0)
        if not str(caught.value).startswith(text) or "\n" in str(caught.value):
            wrong[name] = str(caught.value)
    assert not wrong


def test_errors_of_a_package_are_raised_as_they_are():
    with pytest.raises(DamagedError, match=r"^line 7$"):
        read_guarded(readers.refuse, file="a.obj", errors=(DamagedError,))


def test_pickled_objects_are_refused():
    with pytest.raises(GuardError, match="allow_pickle"):
        read_guarded(readers.return_pickled, file="a.obj")


def test_a_second_file_is_read_at_once():
    read_guarded(readers.echo, file="a.obj")
    start = time.monotonic()
    for _ in range(5):
        read_guarded(readers.echo, file="a.obj")
    assert time.monotonic() - start < 5.0  # a few milliseconds each where the machine is quiet


def test_a_crash_leaves_the_next_file_alone():
    with pytest.raises(GuardError):
        read_guarded(readers.abort, file="a.obj")
    assert read_guarded(readers.echo, 1, file="b.obj")["arguments"] == [1]
