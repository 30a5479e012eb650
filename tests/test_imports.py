"""Modules that importing a package loads, seen in a fresh process, and its public names."""

import json
import subprocess
import sys

import pytest

# Libraries that are heavy or belong elsewhere. What is not allowed to a package must stay out of
# its process: import-linter sees only the imports written in our own code, not what another library
# pulls in.
WATCHED = frozenset(
    {
        "cv2",
        "diffusers",
        "gymnasium",
        "h5py",
        "imageio",
        "mani_skill",
        "matplotlib",
        "open3d",
        "placo",
        "pytorch_kinematics",
        "ray",
        "rich",
        "sapien",
        "scipy",
        "torch",
        "transformers",
        "trimesh",
        "tyro",
        "warp",
    }
)
ALLOWED: dict[str, frozenset[str]] = {
    "dexgarmentlab": frozenset(),
    "dgl_files": frozenset(),
    "dgl_physics": frozenset({"warp"}),
    "dgl_assets": frozenset({"scipy"}),
    "dgl_gam": frozenset({"torch"}),
    "dgl_sadp": frozenset({"h5py", "torch"}),  # diffusers takes seconds: imported where it is used
    # ManiSkill, torch and what they bring along take seconds: only who makes an environment imports
    # them.
    "dgl_tasks": frozenset({"gymnasium", "scipy", "warp"}),
    "dgl_bench.physics": frozenset({"warp"}),
    "dgl_collect": frozenset({"gymnasium", "h5py", "imageio", "scipy", "warp"}),
}

SHARED = (frozenset(), frozenset({"torch"}), frozenset({"warp"}), ALLOWED["dgl_tasks"])
"""Libraries that take long to import, once for all packages that may have them."""

_PROBE = """
import importlib, json, os, sys

def in_fork(do, *arguments):
    process = os.fork()
    if not process:
        do(*arguments)
        sys.stdout.flush()
        os._exit(0)
    assert os.waitpid(process, 0)[1] == 0, arguments

def tell(package):
    module = importlib.import_module(package)
    names = list(getattr(module, "__all__", []))
    print(json.dumps({
        "package": package,
        "missing": [name for name in names if not hasattr(module, name)],
        "twice": sorted({name for name in names if names.count(name) > 1}),
        "loaded": sorted({name.partition(".")[0] for name in sys.modules}),
    }))

def tell_all(libraries, packages):
    for library in libraries:
        importlib.import_module(library)
    for package in packages:
        in_fork(tell, package)

for libraries, packages in json.loads(sys.argv[1]):
    in_fork(tell_all, libraries, packages)
"""


@pytest.fixture(scope="module")
def told():
    """Facts of each package, of a process that has imported nothing else but what is shared."""
    groups = [(sorted(libraries), []) for libraries in SHARED]
    for package, allowed in ALLOWED.items():
        fitting = [k for k, libraries in enumerate(SHARED) if libraries <= allowed]
        most = max(fitting, key=lambda k: len(SHARED[k]))
        groups[most][1].append(package)
    done = subprocess.run(
        [sys.executable, "-c", _PROBE, json.dumps(groups)],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return {facts["package"]: facts for facts in map(json.loads, done.stdout.splitlines())}


@pytest.fixture(params=sorted(ALLOWED))
def imported(request, told):
    """Name of a package, and its facts."""
    return request.param, told[request.param]


def test_every_public_name_exists_once(imported):
    _, facts = imported
    assert facts["missing"] == []
    assert facts["twice"] == []


def test_nothing_heavy_is_imported_that_does_not_belong(imported):
    name, facts = imported
    assert WATCHED & set(facts["loaded"]) <= ALLOWED[name]


def test_no_package_imports_one_above_it(imported):
    name, facts = imported
    below = {
        "dexgarmentlab": set(ALLOWED),
        "dgl_collect": {"dgl_tasks", "dgl_physics", "dgl_assets", "dgl_gam"},
        "dgl_bench.physics": {"dgl_collect", "dgl_tasks", "dgl_physics", "dgl_assets"},
        "dgl_tasks": {"dgl_physics", "dgl_assets"},
    }
    ours = set(ALLOWED) & set(facts["loaded"]) - {name, "dgl_files"}
    assert ours <= below.get(name, set())
