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

_PROBE = """
import importlib, json, sys
module = importlib.import_module(sys.argv[1])
names = list(getattr(module, "__all__", []))
print(json.dumps({
    "missing": [name for name in names if not hasattr(module, name)],
    "twice": sorted({name for name in names if names.count(name) > 1}),
    "loaded": sorted({name.partition(".")[0] for name in sys.modules}),
}))
"""


@pytest.fixture(scope="module", params=sorted(ALLOWED))
def imported(request):
    """Name of a package, and what a fresh process tells after importing it."""
    done = subprocess.run(
        [sys.executable, "-c", _PROBE, request.param],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return request.param, json.loads(done.stdout.splitlines()[-1])


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
