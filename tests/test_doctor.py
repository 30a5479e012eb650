"""`dgl doctor`: right on a machine that works, and right about each fault that is put in."""

import json
import os
import sys

import numpy as np
import pytest

from dexgarmentlab import _probes, doctor
from dexgarmentlab.cli import main
from dexgarmentlab.doctor import Check, check_cache, check_disk, check_python, run_checks, run_probe


def test_python_versions_on_both_sides():
    assert check_python().state == "ok"
    for version in ((3, 10), (3, 12)):
        assert check_python(version).state == "ok"
    for version in ((3, 9), (3, 13)):
        check = check_python(version)
        assert check.state == "fail"
        assert check.fix


def test_disk_space_on_both_sides(tmp_path):
    assert check_disk(tmp_path, needed_bytes=0).state == "ok"
    check = check_disk(tmp_path, needed_bytes=10**18)
    assert check.state == "fail"
    assert "free" in check.fix


def test_a_cache_that_cannot_be_written_is_told_with_the_variable(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "new"))
    assert check_cache().state == "ok"
    (tmp_path / "file").touch()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file" / "in"))
    check = check_cache()
    assert check.state == "fail"
    assert str(tmp_path / "file" / "in") in check.detail
    assert "XDG_CACHE_HOME" in check.fix


@pytest.mark.parametrize("name", ["physics", "video"])
def test_parts_that_work_are_ok(name):
    (check,) = run_checks(only=[name])
    assert (check.state, check.fix) == ("ok", "")


@pytest.mark.render
def test_rendering_works_here_and_names_its_device():
    (check,) = run_checks(only=["rendering"])
    assert check.state == "ok", check.detail
    assert check.detail.startswith("drawn by ")


def test_without_a_vulkan_driver_rendering_fails_with_its_fix(monkeypatch, capsys):
    for variable in ("VK_DRIVER_FILES", "VK_ICD_FILENAMES"):
        monkeypatch.setenv(variable, "/nonexistent/driver.json")
    assert main(["doctor", "--json", "--only", "rendering"]) == 1
    result = json.loads(capsys.readouterr().out)
    (check,) = result["checks"]
    assert result["ok"] is False
    assert check["state"] == "fail"
    assert "mesa-vulkan-drivers" in check["fix"]


def test_status_is_zero_when_only_what_is_optional_is_missing(monkeypatch, capsys):
    monkeypatch.setattr(doctor, "_has_nvidia_driver", lambda: False)
    assert main(["doctor", "--json", "--only", "python", "cuda"]) == 0
    states = {c["name"]: c["state"] for c in json.loads(capsys.readouterr().out)["checks"]}
    assert states == {"python": "ok", "cuda": "optional"}


def test_text_shows_the_fix_below_what_failed(monkeypatch, capsys):
    bad = Check("disk", "fail", "full", "free some space")
    monkeypatch.setitem(doctor.CHECKS, "disk", lambda: bad)
    assert main(["doctor", "--only", "disk"]) == 1
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("FAIL")
    assert "fix: free some space" in lines[1]


def test_an_unknown_check_names_the_known_ones(capsys):
    assert main(["doctor", "--only", "vulcan"]) == 1
    error = capsys.readouterr().err
    assert "'vulcan'" in error
    assert "'rendering'" in error


def test_results_keep_the_order_of_the_checks():
    assert [check.name for check in run_checks(only=["disk", "python"])] == ["python", "disk"]


def probe_as(monkeypatch, tmp_path, body: str) -> None:
    """Let the next probes run a script instead."""
    script = tmp_path / "python"
    script.write_text(f"#!{sys.executable}\nimport os, sys, time\n{body}\n", encoding="utf-8")
    script.chmod(0o755)
    monkeypatch.setattr(sys, "executable", str(script))


def test_a_probe_that_crashes_is_a_failure_with_its_last_words(monkeypatch, tmp_path):
    probe_as(monkeypatch, tmp_path, "print('lost the device', file=sys.stderr)\nos.abort()")
    result = run_probe("rendering")
    assert result.facts == {}
    assert "status -6: lost the device" in result.error


def test_a_probe_that_hangs_is_ended(monkeypatch, tmp_path):
    probe_as(monkeypatch, tmp_path, "time.sleep(60)")
    assert "no answer within 1 s" in run_probe("rendering", timeout_s=1.0).error


def test_a_missing_library_is_told_from_a_missing_package(monkeypatch):
    def answer(name):
        return doctor.ProbeResult({}, errors[name])

    errors = {"packages": "ImportError: libGL.so.1: cannot open shared object file: No such file"}
    monkeypatch.setattr(doctor, "run_probe", answer)
    assert "libgl1" in doctor.check_probed("packages").fix
    errors = {"packages": "ModuleNotFoundError: No module named 'placo'"}
    assert "make setup" in doctor.check_probed("packages").fix


def test_a_driver_that_cannot_be_used_does_not_stop_the_demo(monkeypatch):
    monkeypatch.setattr(doctor, "_has_nvidia_driver", lambda: True)
    monkeypatch.setattr(
        doctor, "run_probe", lambda name: doctor.ProbeResult(facts={}, error="too old")
    )
    check = doctor.check_cuda()
    assert check.state == "optional"
    assert "driver" in check.fix


def orange_box() -> np.ndarray:
    picture = np.zeros((48, 64, 3))
    picture[16:32, 20:44] = (0.9, 0.4, 0.1)
    return picture


def test_a_picture_of_the_box_is_accepted():
    _probes.assert_shows_box(orange_box())


@pytest.mark.parametrize(
    ("picture", "message"),
    [
        (np.zeros((48, 64, 3)), "uniformly black"),
        (np.full((48, 64, 3), 0.7), "one colour"),
        (np.full((48, 64, 3), np.nan), "not numbers"),
        (orange_box()[..., ::-1], "should be orange"),
    ],
)
def test_a_picture_of_anything_else_is_refused(picture, message):
    with pytest.raises(RuntimeError, match=message):
        _probes.assert_shows_box(picture)


def test_a_probes_error_reaches_its_file(tmp_path, monkeypatch):
    def broken():
        raise RuntimeError("no device")

    monkeypatch.setitem(_probes.PROBES, "rendering", broken)
    path = tmp_path / "result.json"
    assert _probes.main(["rendering", str(path)]) == 1
    assert json.loads(path.read_text()) == {"error": "RuntimeError: no device"}
    assert os.listdir(tmp_path) == ["result.json"]
