"""No module changes another's state: tasks are constant, and an episode's state is its driver's."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
SOURCES = [
    path
    for package in ("dgl-collect", "dgl-tasks")
    for path in sorted((ROOT / "packages" / package / "src").rglob("*.py"))
]
OWNED = {"task", "events", "measurements", "mishaps", "beliefs"}
CHANGING = {
    "add", "append", "clear", "discard", "extend", "insert", "pop", "popitem", "remove", "reverse",
    "setdefault", "sort", "update",
}  # fmt: skip


def _reaches_over(node):
    """Say whether a node is such an attribute of something but `self`, or within one."""
    while isinstance(node, ast.Attribute | ast.Subscript | ast.Starred):
        if isinstance(node, ast.Attribute) and node.attr in OWNED:
            return not (isinstance(node.value, ast.Name) and node.value.id == "self")
        node = node.value
    return False


def _flatten(target):
    """The single targets of an assignment to several."""
    if isinstance(target, ast.Tuple | ast.List):
        return [part for element in target.elts for part in _flatten(element)]
    return [target]


def find_changes(source):
    """Lines that assign to, delete or change what `OWNED` names of another object."""
    lines = []
    for node in ast.walk(ast.parse(source)):
        targets = []
        match node:
            case ast.Assign() | ast.Delete():
                targets = node.targets
            case ast.AugAssign() | ast.AnnAssign() | ast.For() | ast.NamedExpr():
                targets = [node.target]
            case ast.With():
                targets = [item.optional_vars for item in node.items if item.optional_vars]
            case ast.Call(func=ast.Attribute(value=owner, attr=name)) if name in CHANGING:
                targets = [owner]
            case ast.Call(
                func=ast.Name(id="setattr" | "delattr"),
                args=[owner, ast.Constant(value=name), *_],
            ) if name in OWNED and not (isinstance(owner, ast.Name) and owner.id == "self"):
                lines.append(node.lineno)
        if any(_reaches_over(part) for target in targets for part in _flatten(target)):
            lines.append(node.lineno)
    return sorted(lines)


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: f"{path.parent.name}/{path.stem}")
def test_no_source_changes_what_belongs_to_another(path):
    assert find_changes(path.read_text(encoding="utf-8")) == []


@pytest.mark.parametrize(
    "line",
    [
        "env.task = task",
        "self.env.task = task",
        "env.task.rounds = 3",
        "driver.events = []",
        "self.driver.measurements['further_rounds'] = 1.0",
        "driver.measurements |= {'further_tries': 1.0}",
        "driver.measurements['a'] += 1",
        "del self.driver.events[2:]",
        "driver.events.append(('slipped', 'there'))",
        "driver.events[0].append('there')",
        "self.driver.measurements.update(found)",
        "a, driver.events = 1, []",
        "[*driver.events] = found",
        "driver.events: list = []",
        "for driver.events in found: pass",
        "setattr(env, 'task', task)",
        "delattr(driver, 'events')",
        "env().task = task",
        "envs[0].task = task",
    ],
)
def test_such_a_change_is_found(line):
    assert find_changes(f"def change():\n    {line}\n") == [2]


@pytest.mark.parametrize(
    "line",
    [
        "self.task = task",
        "self.measurements['a'] = 1.0",
        "self.measurements |= found",
        "self.events.append(found)",
        "task = env.task",
        "measurements = dict(driver.measurements)",
        "events = driver.events + [found]",
        "kept = replace(env.task, rounds=3)",
        "task.events_before = 1",
        "self._task.T_world_frame = T",
        "setattr(self, 'task', task)",
    ],
)
def test_what_is_ones_own_may_change(line):
    assert find_changes(line) == []
