"""`dgl gam data`: its summary, its picture, and what it says of failures and wrong options."""

import importlib
import json
from pathlib import Path

from dexgarmentlab.cli import main

COLLECT_TESTS = Path(__file__).parents[1] / "packages/dgl-collect/tests"
GLOVE = "Glove/000000"


def words(out):
    counts = ["--train", "0", "--test", "0", "--flat", "1", "--flat-test", "0"]
    return ["gam", "data", "--out", str(out), "--category", "Glove", *counts]


def test_data_is_made_drawn_and_continued(tmp_path, capsys, monkeypatch):
    monkeypatch.syspath_prepend(str(COLLECT_TESTS))
    importlib.import_module("dgl_collect_fakes").work_here(monkeypatch)
    out, preview = tmp_path / "data", tmp_path / "sheet.png"
    assert main([*words(out), "--preview", str(preview)]) == 0
    assert preview.read_bytes().startswith(b"\x89PNG")
    capsys.readouterr()
    assert main([*words(out), "--resume", "--json"]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert (summary["garments"], summary["failed"]) == (1, 0)
    assert summary["categories"][0]["made_now"] == 0
    assert main([*words(out), "--resume", "--seed", "1"]) == 1
    assert "its seed is 0, this run's is 1" in capsys.readouterr().err
    (out / f"{GLOVE}.safetensors").unlink()
    failure = json.dumps({"id": GLOVE, "reason": "pressed: it burst"})
    (out / "failures.jsonl").write_text(failure + "\n", encoding="utf-8")
    assert main([*words(out), "--resume"]) == 1  # nothing is there, and why is said
    written = capsys.readouterr()
    assert f"failed: {GLOVE}: pressed: it burst" in written.out
    assert "no garment could be made" in written.err


def test_wrong_options_are_refused(tmp_path, capsys):
    for more, message in (
        (["--category", "Scraf"], "did you mean Scarf?"),
        (["--flat", "0"], "at least 1 garment must be made"),
        (["--workers", "0"], "workers must be at least 1; got 0"),
    ):
        assert main([*words(tmp_path / "x"), *more]) == 1
        assert message in capsys.readouterr().err
        assert not (tmp_path / "x" / "run.json").exists()
