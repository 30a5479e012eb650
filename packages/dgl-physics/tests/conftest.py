"""Sheets, a run of frames, and the devices to run on."""

import importlib.util
import re
from pathlib import Path

import numpy as np
import pytest
import warp as wp

from dgl_physics import ModelBuilder, SolverConfig
from dgl_physics.scene import Scene


@pytest.fixture(params=["cpu", pytest.param("cuda:0", marks=pytest.mark.gpu)], ids=["cpu", "cuda"])
def device(request):
    """Each device that there is; the others skip visibly."""
    if request.param != "cpu" and not wp.is_cuda_available():
        pytest.skip("no CUDA device")
    return request.param


def hex_sheet(width, length, edge, *, height=0.0):
    """Make a flat sheet of equilateral triangles, centred on the z axis.

    Args:
        width: Along x [m].
        length: Along y [m].
        edge: Length of an edge [m].
        height: z of the sheet [m].

    Returns:
        Vertices (V, 3) row by row, and faces (F, 3) with normals up.
    """
    rows = max(round(length / (edge * np.sqrt(0.75))), 1) + 1
    columns = max(round(width / edge), 1) + 1
    r, c = np.divmod(np.arange(rows * columns), columns)
    x = (c + 0.5 * (r % 2) - 0.5 * (columns - 0.5)) * edge
    y = (r - 0.5 * (rows - 1)) * edge * np.sqrt(0.75)
    faces = []
    for i in range(rows - 1):
        for j in range(columns - 1):
            a, b = i * columns + j, i * columns + j + 1
            d, e = a + columns, b + columns
            faces += [(a, b, d), (b, e, d)] if i % 2 == 0 else [(a, b, e), (a, e, d)]
    vertices = np.column_stack([x, y, np.full(len(x), float(height))])
    return vertices, np.array(faces, dtype=np.int32)


class Run(Scene):
    """A scene whose settings are keywords, and whose steps can be chained."""

    def __init__(self, builder, *, device="cpu", **config):
        super().__init__(builder, SolverConfig(**config), device=device)

    def step(self, frames=1):
        super().step(frames)
        return self


@pytest.fixture
def unrefused():
    """Find the rows (call, message) whose call raises no ValueError with that message."""

    def find(rows, error=ValueError):
        wrong = []
        for call, message in rows:
            try:
                call()
            except error as err:
                if not re.search(message, str(err)):
                    wrong.append((message, str(err)))
            else:
                wrong.append((message, "nothing is raised"))
        return wrong

    return find


@pytest.fixture
def sheet():
    return hex_sheet


@pytest.fixture
def builder():
    return ModelBuilder(1)


@pytest.fixture
def run():
    return Run


@pytest.fixture(scope="session")
def meshes():
    """The module of closed surfaces beside this file."""
    spec = importlib.util.spec_from_file_location("meshes", Path(__file__).parent / "meshes.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
