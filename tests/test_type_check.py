"""`make type` reads the source of every package."""

import sys
from pathlib import Path

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

ROOT = Path(__file__).resolve().parent.parent


def test_every_source_folder_is_listed():
    # Folders without wildcards: pyright passes over a pattern that matches nothing.
    content = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    # What is for LeRobot needs its packages, and has an environment of its own.
    folders = [path for path in ROOT.glob("packages/dgl-*/src") if any(path.rglob("*.py"))]
    folders += [ROOT / "src", ROOT / "benchmarks/src"]
    found = sorted(str(path.relative_to(ROOT)) for path in folders)
    assert len(found) > 2
    assert sorted(content["tool"]["pyright"]["include"]) == found
