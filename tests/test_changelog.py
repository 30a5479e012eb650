"""The changelog speaks of the version that is here."""

import re
from importlib import metadata
from pathlib import Path

CHANGELOG = Path(__file__).resolve().parent.parent / "CHANGELOG.md"


def test_there_is_an_entry_for_what_is_unreleased_or_for_this_version():
    headings = re.findall(r"^## \[?([^\]\s]+)", CHANGELOG.read_text(encoding="utf-8"), re.MULTILINE)
    assert headings
    assert headings[0] in {"Unreleased", metadata.version("dexgarmentlab")}


def test_no_entry_is_empty():
    text = CHANGELOG.read_text(encoding="utf-8")
    for section in re.split(r"^##+ ", text, flags=re.MULTILINE)[1:]:
        heading, _, body = section.partition("\n")
        if heading.startswith("dgl-") or heading == "dexgarmentlab":
            assert body.strip(), f"no line below {heading}"
