"""The leaves know nothing of each other, so each has its own copy of what checks a file; the copies do not drift apart."""

from pathlib import Path

PACKAGES = Path(__file__).parent.parent / "packages"


def test_fields_are_checked_alike():
    ours, theirs = (
        (PACKAGES / name / "src" / name.replace("-", "_") / "_fields.py").read_text("utf-8")
        for name in ("dgl-gam", "dgl-sadp")
    )
    assert "def " in ours
    assert ours == theirs
