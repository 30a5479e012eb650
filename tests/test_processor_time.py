"""The limit of processor time that continuous integration sets for the default tests."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]


@pytest.mark.slow
@pytest.mark.parametrize(("limit", "status"), [(10, 0), (1e-4, 1)])
def test_tests_that_take_too_long_fail(limit, status):
    """Two of xdist's processes add up."""
    command = [sys.executable, "-m", "pytest", "tests/test_pins.py", "--numprocesses", "2"]
    done = subprocess.run(
        [*command, f"--processor-limit={limit}"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == status, done.stdout
    assert "20 longest tests, by processor time" in done.stdout
    assert " s  tests/test_pins.py::" in done.stdout
    assert f"limit {limit:g} min" in done.stdout
