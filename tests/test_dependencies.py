"""Every third-party module that a package imports is declared in its pyproject."""

import ast
import functools
import re
import sys
from importlib.metadata import files, packages_distributions
from pathlib import Path

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

ROOT = Path(__file__).resolve().parent.parent
PROJECTS = [ROOT, ROOT / "benchmarks", *sorted((ROOT / "packages").glob("dgl-*"))]

# Distributions whose files do not say at their top which modules they bring, or that need not be
# installed here.
KNOWN = {
    "newton": "newton",
    "placo": "placo",
    "pxr": "usd-core",
    "triton": "torch",
    "collada": "pycollada",
}
# It tries whether what the other packages ask for can be imported, and says so if it cannot.
PROBES = ROOT / "src/dexgarmentlab/_probes.py"
# `dgl bench` says so where the benchmarks are not installed: they are no part of the wheels.
OPTIONAL = {"dgl_bench": "src/dexgarmentlab/cli/bench*.py"}


def normalise(name):
    """The name of a requirement or distribution as registries compare it."""
    return re.sub(r"[-_.]+", "-", re.match(r"[A-Za-z0-9._-]+", name).group()).lower()


def find_declared(project):
    """Distributions that a project asks for, those of its extras too, and itself."""
    content = tomllib.loads((project / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    wanted = [content["name"], *content["dependencies"]]
    for extra in content.get("optional-dependencies", {}).values():
        wanted += extra
    return {normalise(name) for name in wanted}


def find_imported(source):
    """Top-level modules imported anywhere in a source, with the line of the first import."""
    found = {}
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            names = [node.module]
        else:
            continue
        for name in names:
            found.setdefault(name.partition(".")[0], node.lineno)
    return found


@functools.cache
def _list_installed():
    return packages_distributions()


def find_distributions(module):
    """Distributions that bring a module; of ours, their own name."""
    if module.startswith("dgl_") or module == "dexgarmentlab":
        return {normalise(module)}
    installed = {normalise(name) for name in _list_installed().get(module, [])}
    return installed | ({KNOWN[module]} if module in KNOWN else set())


def find_undeclared(project, declared):
    """Imports of a project that no distribution of `declared` brings, as `module: file:line`."""
    undeclared = []
    for path in sorted((project / "src").rglob("*.py")):
        if path == PROBES:
            continue
        for module, line in find_imported(path.read_text(encoding="utf-8")).items():
            if module in sys.stdlib_module_names or path in ROOT.glob(OPTIONAL.get(module, "-")):
                continue
            if not find_distributions(module) & declared:
                undeclared.append(f"{module}: {path.relative_to(ROOT)}:{line}")
    return undeclared


def test_every_imported_module_is_asked_for():
    assert len(PROJECTS) == 9
    undeclared = {path.name: find_undeclared(path, find_declared(path)) for path in PROJECTS}
    assert {name: found for name, found in undeclared.items() if found} == {}


def test_a_module_that_is_not_asked_for_is_found():
    project = ROOT / "packages/dgl-gam"
    declared = find_declared(project)
    assert {"dgl-gam", "numpy", "torch"} <= declared
    missing = {item.partition(":")[0] for item in find_undeclared(project, declared - {"torch"})}
    assert missing == {"torch"}


def test_imports_are_found_wherever_they_stand():
    source = (
        "import a.b\nfrom c import d as e\nfrom . import f\n"
        "if TYPE_CHECKING:\n    import g\ndef h():\n    from i.j import k\n"
    )
    assert find_imported(source) == {"a": 1, "c": 2, "g": 5, "i": 7}


def test_modules_are_known_by_their_distributions():
    assert find_distributions("PIL") == {"pillow"}
    assert find_distributions("warp") == {"warp-lang"}
    assert find_distributions("dgl_collect") == {"dgl-collect"}
    assert find_distributions("no_such_module") == set()
    assert files("placo")  # installed, though its modules are in a folder of their own
