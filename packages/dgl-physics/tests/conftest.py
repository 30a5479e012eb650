"""Sheets, a run of frames, and the devices to run on."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest
import warp as wp

from dgl_physics import ModelBuilder, SolverConfig, SolverXPBD, State


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


class Run:
    """A model, its state and its solver, of sheets and shapes given to `simulate`."""

    def __init__(self, builder, *, device="cpu", **config):
        self.model = builder.build(device)
        self.state = State(self.model)
        self.solver = SolverXPBD(self.model, SolverConfig(**config))
        self.mass = np.zeros(self.model.env_count * self.model.particles_per_env)
        w = self.model.inverse_mass.numpy()
        self.mass[w > 0] = 1.0 / w[w > 0]

    def step(self, frames=1):
        for _ in range(frames):
            self.solver.step(self.state)
        return self

    def move(self, poses, *, is_jump=False):
        """Set the poses of the bodies of the only environment, given without the world's."""
        world = [[0, 0, 0, 1, 0, 0, 0]]
        poses = np.concatenate([world, np.reshape(poses, (-1, 7))])
        self.state.set_body_poses(poses[None].astype(np.float32), is_jump=is_jump)

    @property
    def x(self):
        return self.state.get_positions()[0].astype(np.float64)

    @property
    def v(self):
        return self.state.get_velocities()[0].astype(np.float64)

    def strain(self):
        """Relative change of length of each edge, shape (E,)."""
        g = self.model.garments[0]
        ends = self.x[g.first + g.edges]
        return np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1) / g.rest_lengths - 1.0


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
