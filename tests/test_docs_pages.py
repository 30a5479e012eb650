"""Markdown pages: each link leads to a file and a heading in it; each `dgl` command is one."""

import contextlib
import io
import re
import shlex
from pathlib import Path

from dexgarmentlab.cli import VERBS, read_options

ROOT = Path(__file__).parents[1]
PAGES = sorted(
    page
    for pattern in ("*.md", "docs/**/*.md", "packages/*/*.md", "packages/*/benchmarks/**/*.md")
    for page in ROOT.glob(pattern)
)
BLOCK = re.compile(r"^```(?:bash)?\n(.*?)^```", re.MULTILINE | re.DOTALL)


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


def find_commands():
    """Commands of a page's code blocks, with the page."""
    for page in PAGES:
        for block in BLOCK.findall(page.read_text(encoding="utf-8")):
            for line in block.replace("\\\n", " ").splitlines():
                if re.match(r"dgl [a-z]", line):
                    words = shlex.split(line, comments=True)[1:]
                    yield f"{page.relative_to(ROOT)}: {line.strip()}", words


def test_each_command_of_a_page_is_taken():
    commands, refused = dict(find_commands()), []
    verbs = {verb.name: verb for verb in VERBS}
    for line, words in commands.items():
        with contextlib.redirect_stderr(io.StringIO()) as told, contextlib.suppress(SystemExit):
            read_options(verbs[words[0]], words[1:])
            continue
        refused.append(f"{line}\n{told.getvalue()}")
    assert refused == []
    assert len(commands) > 60
