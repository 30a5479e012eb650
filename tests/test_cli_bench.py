"""The verb `bench`."""

import json
import subprocess
import sys

import pytest

from dexgarmentlab import _bench_physics
from dexgarmentlab._bench_physics import Row
from dexgarmentlab.cli import main


@pytest.fixture
def made_up(monkeypatch):
    rows = [
        Row(name="fast", value=5.0, unit="ms", bar="<= 10"),
        Row(name="slow", value=10.1, unit="ms", bar="<= 10"),
        Row(name="many", value=123456.0, unit="1/s", bar=">= 100"),
        Row(name="broken", value=None, unit="mm", bar="<= 2"),
        Row(name="plain", value=0.5, unit="%"),
    ]
    efforts = []

    def measure(*, effort):
        efforts.append(effort)
        yield from rows

    monkeypatch.setattr(_bench_physics, "measure", measure)
    return efforts


def test_rows_as_json(made_up, capsys):
    assert main(["bench", "physics", "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)
    assert [list(row) for row in rows] == [["name", "value", "unit", "bar", "ok"]] * 5
    assert [row["ok"] for row in rows] == [True, False, True, False, None]
    assert rows[1] == {"name": "slow", "value": 10.1, "unit": "ms", "bar": "<= 10", "ok": False}
    assert rows[3]["value"] is None
    assert rows[4]["bar"] is None


def test_rows_as_a_table(made_up, capsys):
    assert main(["bench", "physics"]) == 0
    lines = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert lines[0] == ["name", "value", "unit", "bar", "ok"]
    assert lines[1] == ["fast", "5", "ms", "<=", "10", "yes"]
    assert lines[3] == ["many", "123,456", "1/s", ">=", "100", "yes"]
    assert lines[4] == ["broken", "failed", "mm", "<=", "2", "no"]
    assert lines[5] == ["plain", "0.5", "%"]


def test_quick_times_fewer_frames(made_up, capsys):
    for arguments in ([], ["--quick"]):
        main(["bench", "physics", *arguments])
    capsys.readouterr()
    assert made_up == [1.0, 0.1]


def test_an_unknown_subject_is_refused(capsys):
    assert main(["bench", "weather"]) == 2
    assert "physics" in capsys.readouterr().err


def test_the_physics_is_measured():
    """For real, in a new process, as Warp greets in a new process only; nothing but JSON comes out."""
    command = [
        sys.executable,
        "-c",
        "import sys; from dexgarmentlab.cli import main; sys.exit(main())",
    ]
    done = subprocess.run(
        [*command, "bench", "physics", "--quick", "--json"],
        capture_output=True,
        text=True,
        check=True,
    )
    rows = json.loads(done.stdout)
    assert len(rows) == _bench_physics.count_rows()
    assert len({row["name"] for row in rows}) == len(rows)
    assert all(row["value"] is None or row["value"] >= 0 for row in rows)
    speed = next(row for row in rows if row["unit"] == "ms")
    assert 0.01 < speed["value"] < 1000
