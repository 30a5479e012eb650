"""Links and headings of all Markdown pages: each link leads to a file, and to a heading in it."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[1]
PAGES = sorted(
    page
    for pattern in ("*.md", "docs/**/*.md", "packages/*/*.md", "packages/*/benchmarks/**/*.md")
    for page in ROOT.glob(pattern)
)


def read_prose(page):
    """Lines of a page outside of code blocks, with their numbers."""
    is_code, lines = False, []
    for number, line in enumerate(page.read_text(encoding="utf-8").splitlines(), 1):
        if line.lstrip().startswith("```"):
            is_code = not is_code
        elif not is_code:
            lines.append((number, line))
    return lines


def find_anchors(page):
    """Anchors that GitHub gives to the headings of a page."""
    headings = [line.lstrip("# ") for _, line in read_prose(page) if line.startswith("#")]
    plain = [re.sub(r"[^\w\- ]", "", heading.lower()) for heading in headings]
    return {heading.replace(" ", "-") for heading in plain}


def test_every_link_leads_somewhere():
    broken = []
    for page in PAGES:
        for number, line in read_prose(page):
            for target in re.findall(r"\]\(([^)\s]+)\)", line):
                path, _, anchor = target.partition("#")
                if "://" in target or target.startswith("mailto:"):
                    continue
                found = (page.parent / path).resolve() if path else page
                if not found.exists() or (anchor and anchor not in find_anchors(found)):
                    broken.append(f"{page.relative_to(ROOT)}:{number}: {target}")
    assert broken == []
