"""Code that all tasks share names no task, no family of tasks, and no kind of garment or object."""

import io
import re
import tokenize
from pathlib import Path

import pytest

from dgl_assets.garments.registry import CATEGORIES
from dgl_assets.props import PROP_KINDS
from dgl_tasks import task_ids

PACKAGES = Path(__file__).parent.parent / "packages"
SHARED = [
    path
    for package in ("dgl-tasks/src", "dgl-collect/src")
    for path in sorted((PACKAGES / package).rglob("*.py"))
    if not {"dgl_tasks/tasks", "dgl_collect/gam_data"} & {"/".join(path.parts[-3:-1])}
    and path.stem != "layouts"  # data that declarations choose from
]
FAMILIES = ("fold", "fling", "flung", "hang", "store", "wear")
DEFAULT = {"FoldTops", "Tops_LongSleeve"}  # examples in docstrings


def names_of(path):
    """Identifiers and texts of a file, without its comments and docstrings."""
    before = tokenize.INDENT
    for token in tokenize.generate_tokens(io.StringIO(path.read_text()).readline):
        is_docstring = token.type == tokenize.STRING and before in (
            tokenize.INDENT,
            tokenize.NEWLINE,
            tokenize.NL,
        )
        if token.type == tokenize.NAME or (token.type == tokenize.STRING and not is_docstring):
            yield token.string, token.start[0]
        if token.type not in (tokenize.COMMENT,):
            before = token.type


def split(name):
    return [part.lower() for part in re.findall(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])", name)]


@pytest.mark.parametrize("path", SHARED, ids=lambda path: path.stem)
def test_shared_code_names_no_task_and_no_kind(path):
    stems = {task.partition("-")[0] for task in task_ids()}
    found = []
    for name, line in names_of(path):
        words = split(name)
        if any(word in FAMILIES for word in words):
            found.append((line, name))
        if any(stem in name for stem in stems) or any(kind in name for kind in CATEGORIES):
            found.append((line, name))
        if name[0] in "\"'" and name.strip("\"'") in PROP_KINDS:
            found.append((line, name))
    assert found == []


def test_names_are_found_where_there_are_some(tmp_path):
    file = tmp_path / "code.py"
    file.write_text('"""Fold."""\n\nFLING_ROLL = 1  # fold\nx = {"hanger": "FoldTops-v1"}\n')
    assert [name for name, _ in names_of(file)] == [
        "FLING_ROLL", "x", '"hanger"', '"FoldTops-v1"',
    ]  # fmt: skip
    assert split("FLING_ROLL") == ["fling", "roll"]
