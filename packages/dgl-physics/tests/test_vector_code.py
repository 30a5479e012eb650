"""Vector code gives what Warp's own code gives, to the bit."""

import logging

import numpy as np
import pytest
import warp as wp

from dgl_physics import (
    ClothMaterial,
    CollisionMesh,
    ModelBuilder,
    Shape,
    SolidMaterial,
    SolverConfig,
    SolverXPBD,
    State,
    UnsupportedCpuError,
    launcher,
)
from dgl_physics._kernels import selfcontact
from dgl_physics._kernels.vector.lanes import LANES
from dgl_physics._kernels.vector.twins import TWINS
from dgl_physics.launcher import Launcher, find_vector_obstacle

EDGE = 0.012
NEEDS_VECTOR_CODE = pytest.mark.skipif(
    find_vector_obstacle() is not None, reason="this CPU runs no vector code"
)


def crumple(vertices, rng):
    """Push a sheet together, so that layers of it lie in each other's way."""
    x = vertices * [0.4, 0.6, 1.0]
    x[:, 2] += 0.05 + 0.02 * np.sin(40 * vertices[:, 0]) + rng.uniform(0, 0.004, len(x))
    return x


def add_crumpled(builder, sheet, *, size=0.17, env=None, height=0.0, **arguments):
    vertices, faces = sheet(size, size, EDGE)
    x = crumple(vertices, np.random.default_rng(0))
    x[:, 2] += height
    builder.add_garment(x, faces, rest=vertices, env=env, **arguments)


def make_heap(sheet, meshes):
    """A crumpled sheet on the ground; its particles fill no whole number of lanes."""
    builder = ModelBuilder()
    builder.add_ground(0.5)
    add_crumpled(builder, sheet)
    return builder


def make_damped_yarns(sheet, meshes):
    """Fabric with yarns and damping, pinned at two corners."""
    builder = ModelBuilder()
    builder.add_ground()
    vertices, faces = sheet(0.15, 0.15, EDGE, height=0.3)
    material = ClothMaterial(shear_stiffness=30.0, stretch_damping=0.01, bending_damping=0.02)
    builder.add_garment(vertices, faces, rest=vertices[:, :2], material=material, pinned=(0, 7))
    return builder


def make_torn(sheet, meshes):
    """Edges at four times their length, and particles faster than allowed."""
    builder = ModelBuilder()
    builder.add_ground()
    vertices, faces = sheet(0.1, 0.1, EDGE, height=0.004)
    x = vertices.copy()
    x[::7, :2] *= 4.0
    builder.add_garment(x, faces, rest=vertices)
    return builder


def make_environments(sheet, meshes):
    """Two environments with unlike garments, of two materials, on two planes that stand still."""
    builder = ModelBuilder(2)
    builder.add_ground(0.4)
    builder.add_shape(Shape(kind="plane", pose=np.array([0.05, 0, 0, 0.707, 0, -0.707, 0])))
    add_crumpled(builder, sheet, env=0)
    add_crumpled(builder, sheet, size=0.1, env=0, height=0.08, material=ClothMaterial(drag=0.5))
    add_crumpled(builder, sheet, size=0.13, env=1)
    return builder


def make_shapes(sheet, meshes):
    """A moving finger presses a sheet onto a moving ring, box, sphere and cylinder."""
    builder = ModelBuilder()
    builder.add_ground()
    add_crumpled(builder, sheet, height=0.03)
    vertices, faces = meshes.make_torus(0.05, 0.02, rings=48, sides=12)
    ring = CollisionMesh(vertices=vertices, faces=faces)
    shapes = [
        Shape(kind="capsule", size=(0.01, 0.03, 0.0), pose=np.array([0, 0, 0.13, 1, 0, 0, 0])),
        Shape(kind="mesh", mesh=ring, pose=np.array([0, 0, 0.02, 1, 0, 0, 0])),
        Shape(kind="box", size=(0.02, 0.03, 0.02), pose=np.array([0.06, 0, 0.02, 1, 0, 0, 0])),
        Shape(kind="sphere", size=(0.02, 0, 0), pose=np.array([-0.06, 0, 0.03, 1, 0, 0, 0])),
        Shape(kind="cylinder", size=(0.02, 0.04, 0), pose=np.array([0, 0.06, 0.04, 1, 0, 0, 0])),
    ]
    for k, shape in enumerate(shapes):
        builder.add_shape(shape, body=builder.add_body(f"body {k}"))
    return builder


def make_solid(sheet, meshes):
    """A sheet that falls onto an elastic box, which has particles inside."""
    builder = ModelBuilder()
    builder.add_ground()
    vertices, faces = meshes.make_box(np.array([0.05, 0.04, 0.02]))
    material = SolidMaterial(youngs_modulus=2e4, density=200.0)
    vertices[:, 2] += 0.025
    builder.add_solid(vertices, faces, material=material, resolution=6)
    add_crumpled(builder, sheet)
    return builder


SCENES = {
    make.__name__: make
    for make in (
        make_heap,
        make_damped_yarns,
        make_torn,
        make_environments,
        make_shapes,
        make_solid,
    )
}


def play(builder, cpu_code, *, frames=20, check=None, **config):
    """Move the bodies down and across, and wake and set an environment in between."""
    model = builder.build("cpu")
    state, solver = State(model), None
    solver = SolverXPBD(model, SolverConfig(cpu_code=cpu_code, sleep_after=0.15, **config))
    if check is not None:
        check(solver)
    poses = np.zeros((model.env_count, model.body_count, 7), dtype=np.float32)
    poses[..., 3] = 1.0
    seen = []
    for frame in range(frames):
        poses[:, 1:, 2] -= 0.002
        poses[:, 1:, 0] += 0.001
        state.set_body_poses(poses, is_jump=frame == 0)
        if frame == frames * 3 // 5:
            state.set_particles(state.get_positions()[:1] + 0.001, envs=np.array([0]))
            if model.env_count > 1:
                sleeping = state.still.numpy().copy()
                sleeping[1] = 1000
                state.still.assign(sleeping)
        solver.step(state)
        seen.append(state.get_positions())
    return np.array(seen), state


class Compared:
    """Runs each kernel and its twin on the same numbers."""

    def __init__(self, solver):
        self.seen = set()
        count = solver.model.env_count * solver.model.particles_per_env
        self._warp, self._vector = (Launcher("cpu", code, count) for code in ("warp", "vector"))
        solver._replay = lambda name, launch: launch()
        own = solver._launcher
        own.launch, own.launch_colours = self.launch, self.launch_colours
        own.has_twin = lambda kernel: False  # what kernels need is made ready too

    def launch(self, kernel, dim, inputs):
        self._compare(kernel, inputs, lambda own, given: own.launch(kernel, dim, given))

    def launch_colours(self, kernel, starts, inputs):
        self._compare(kernel, inputs, lambda own, given: own.launch_colours(kernel, starts, given))

    def _compare(self, kernel, inputs, launch):
        copies = [wp.clone(a) if isinstance(a, wp.array) else a for a in inputs]
        launch(self._warp, copies)
        launch(self._vector, inputs)
        names = [argument.label for argument in kernel.adj.args]
        for name, copy, given in zip(names[-len(inputs) :], copies, inputs, strict=True):
            if isinstance(copy, wp.array):
                mine, its = given.numpy(), copy.numpy()
                if (
                    kernel is selfcontact.find_neighbours and name == "neighbours"
                ):  # what is behind the end of a list is left as it is
                    counts = inputs[-2].numpy()
                    capacity = len(mine) // len(counts)
                    used = np.arange(capacity) < counts[:, None]
                    mine, its = (a[: used.size].reshape(used.shape)[used] for a in (mine, its))
                np.testing.assert_array_equal(mine, its, f"{kernel.key} differs in {name}")
        self.seen.add(kernel)


@NEEDS_VECTOR_CODE
@pytest.mark.parametrize("scene", SCENES)
def test_each_twin_equals_its_kernel(sheet, meshes, scene):
    compared = []
    _, state = play(
        SCENES[scene](sheet, meshes),
        "vector",
        frames=6,
        check=lambda solver: compared.append(Compared(solver)),
    )
    assert np.isfinite(state.get_positions()).all()
    assert set(TWINS) <= compared[0].seen


# In the default tests, `test_each_twin_equals_its_kernel` covers the scenes left out here.
LONG = ("make_damped_yarns", "make_torn", "make_environments")


@NEEDS_VECTOR_CODE
@pytest.mark.parametrize(
    "scene", [pytest.param(s, marks=pytest.mark.slow) if s in LONG else s for s in SCENES]
)
def test_both_codes_give_equal_particles(sheet, meshes, scene):
    mine, state = play(SCENES[scene](sheet, meshes), "vector")
    its, other = play(SCENES[scene](sheet, meshes), "warp")
    assert np.abs(np.diff(mine, axis=0)).max() > 1e-4
    np.testing.assert_array_equal(mine, its)
    np.testing.assert_array_equal(state.impulse.numpy(), other.impulse.numpy())
    np.testing.assert_array_equal(state.get_memory(), other.get_memory())


@NEEDS_VECTOR_CODE
def test_lists_that_are_too_short_grow_and_change_nothing(sheet, meshes):
    courses = []
    for cpu_code, change in (
        ("vector", {}),
        ("vector", {"neighbour_capacity": 2}),
        ("vector", {"near_capacity": 1}),
        ("warp", {"neighbour_capacity": 2, "near_capacity": 1}),
    ):
        mine, state = play(make_shapes(sheet, meshes), cpu_code, frames=10, **change)
        courses.append((mine, state.get_memory(), state.impulse.numpy()))
    for other in courses[1:]:
        for mine, its in zip(courses[0], other, strict=True):
            np.testing.assert_array_equal(mine, its)


def run_lanes(code, values):
    """Run C++ on `value`, int32 arrays of eight, which it may change; `mask` is their row."""

    @wp.func_native(LANES + code)
    def change(value: wp.array(dtype=wp.int32), mask: wp.int32): ...

    @wp.kernel
    def each(value: wp.array2d(dtype=wp.int32)):
        for row in range(value.shape[0]):
            change(value[row], row)

    array = wp.array(values, dtype=wp.int32, device="cpu")
    wp.launch(each, dim=1, inputs=[array], device="cpu")
    return array.numpy()


BITS = np.arange(256)[:, None] >> np.arange(8) & 1


@NEEDS_VECTOR_CODE
def test_eight_lanes_are_sorted():
    """A network that sorts all rows of zeros and ones sorts all numbers (Knuth)."""
    code = "lane::store(value.data, lane::sort(lane::load(value.data)));"
    np.testing.assert_array_equal(run_lanes(code, BITS), np.sort(BITS, axis=1))


@NEEDS_VECTOR_CODE
def test_lanes_are_compressed():
    code = "lane::store(value.data, lane::compress(lane::load(value.data), mask));"
    out = run_lanes(code, np.tile(np.arange(8), (256, 1)))
    for row, bits in zip(out, BITS, strict=True):
        np.testing.assert_array_equal(row[: bits.sum()], np.flatnonzero(bits))


@pytest.mark.parametrize(
    ("machine", "flags", "told"),
    [
        ("x86_64", "fpu avx avx2 fma", None),
        ("x86_64", "fpu avx", "it lacks avx2 and fma"),
        ("x86_64", "fpu avx2x fma", "it lacks avx2"),
        ("aarch64", None, None),
        ("riscv64", None, "its architecture is riscv64"),
        ("x86_64", None, "is missing"),
    ],
)
def test_missing_cpu_instructions_are_named(monkeypatch, tmp_path, machine, flags, told):
    monkeypatch.setattr(launcher.platform, "machine", lambda: machine)
    file = tmp_path / "cpuinfo"
    if flags is not None:
        file.write_text(f"processor\t: 0\nflags\t\t: {flags}\n")
    found = find_vector_obstacle(file)
    assert (found is None) == (told is None)
    assert told is None or told in found


def test_a_cpu_without_vector_code(monkeypatch, caplog):
    """It is said in one line that Warp's code runs; asking for vector code is refused."""
    monkeypatch.setattr(launcher, "find_vector_obstacle", lambda: "it lacks avx2")
    launcher.warn_once.cache_clear()
    with caplog.at_level(logging.WARNING):
        assert not any(Launcher("cpu", "auto", 9).has_twin(kernel) for kernel in TWINS)
    assert len(caplog.records) == 1
    assert "it lacks avx2" in caplog.text
    with pytest.raises(UnsupportedCpuError, match="it lacks avx2"):
        Launcher("cpu", "vector", 9)
    assert not any(Launcher("cpu", "warp", 9).has_twin(kernel) for kernel in TWINS)


def test_an_unknown_code_is_refused():
    with pytest.raises(ValueError, match=r"cpu_code must be one of .*'vector'.*; got 'avx'"):
        SolverConfig(cpu_code="avx")
