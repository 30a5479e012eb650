"""Fail where a docstring opens with a question word, or a line of Markdown is too long.

Checks the docstrings of modules, classes, functions and attributes. Tables and code blocks of
Markdown may have longer lines.

Example: python scripts/check_text.py
"""

import ast
import re
import sys
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
WIDTH = 100
_QUESTION = re.compile(r"(What|How|Whether|Who|Which|Where|When)\b")
_SOURCES = ("src", "packages", "benchmarks", "scripts", "tests", "conftest.py")


def find_questions(source: str) -> Iterator[int]:
    """Yield the lines of docstrings that open with a question word."""
    for node in ast.walk(ast.parse(source)):
        body = getattr(node, "body", None)
        for statement in body if isinstance(body, list) else ():
            match statement:
                case ast.Expr(value=ast.Constant(value=str(text))) if _QUESTION.match(text.strip()):
                    yield statement.lineno


def find_long_lines(text: str) -> Iterator[int]:
    """Yield the lines of prose in Markdown that are too long."""
    is_code = False
    for number, line in enumerate(text.splitlines(), start=1):
        is_code ^= line.lstrip().startswith("```")
        if len(line) > WIDTH and not is_code and not line.lstrip().startswith("|"):
            yield number


def find_faults() -> Iterator[str]:
    """Yield each fault of the tree as `path:line: message`."""
    for name in _SOURCES:
        for path in sorted((ROOT / name).rglob("*.py")) or [ROOT / name]:
            for line in find_questions(path.read_text(encoding="utf-8")):
                yield f"{path.relative_to(ROOT)}:{line}: docstring opens with a question word"
    pages = [*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md"), *ROOT.glob("*/README.md")]
    for path in sorted({*pages, *ROOT.glob("packages/*/README.md")}):
        for line in find_long_lines(path.read_text(encoding="utf-8")):
            yield f"{path.relative_to(ROOT)}:{line}: line of more than {WIDTH} characters"


def main() -> int:
    """Print the faults; return 1 if there are some."""
    faults = list(find_faults())
    print("\n".join(faults[:50]))
    print(f"{len(faults)} faults of text")
    return int(bool(faults))


if __name__ == "__main__":
    sys.exit(main())
