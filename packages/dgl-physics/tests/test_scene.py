"""The short way to a simulation, and what lays garments flat."""

import subprocess
import sys

import numpy as np
import pytest

from dgl_physics import ModelBuilder, Shape
from dgl_physics.lay_flat import FRAMES, lay_flat
from dgl_physics.scene import Scene


def test_a_scene_is_one_environment_and_its_measures(sheet):
    vertices, faces = sheet(0.1, 0.1, 0.02, height=1.0)
    builder = ModelBuilder()
    builder.add_garment(vertices, faces, pinned=(0,))
    scene = Scene(builder)
    np.testing.assert_allclose(scene.x, vertices, atol=1e-6)
    np.testing.assert_array_equal(scene.faces, faces)
    assert scene.mass[0] == 0.0
    assert (scene.mass[1:] > 0).all()
    assert np.abs(scene.strain()).max() < 1e-5
    assert scene.rms_speed() == 0.0
    scene.step(6)
    np.testing.assert_allclose(scene.x[0], vertices[0], atol=1e-6)
    assert (scene.v[1:, 2] < 0).all()
    assert 0.7 < scene.rms_speed() < 0.98  # what is held and the air hold back


def test_bodies_of_a_scene_are_moved(sheet):
    builder = ModelBuilder()
    builder.add_garment(*sheet(0.1, 0.1, 0.02, height=0.1))
    builder.add_shape(Shape(kind="box", size=(0.2, 0.2, 0.02)), body=builder.add_body("plate"))
    scene = Scene(builder)
    pose = np.array([0.0, 0, 0.05, 1, 0, 0, 0])
    scene.move(pose, is_jump=True)
    scene.step(60)
    assert scene.x[:, 2].min() == pytest.approx(0.074, abs=0.003)


def test_a_leaning_sheet_lies_flat_afterwards(sheet):
    vertices, faces = sheet(0.2, 0.1, 0.02)
    leaning = vertices @ np.array([[0.9, 0, 0.436], [0, 1, 0], [-0.436, 0, 0.9]])
    frames = []
    lain = lay_flat(leaning, faces, vertices, on_frame=lambda: frames.append(1))
    assert len(frames) == FRAMES
    assert lain.dtype == np.float64
    assert np.ptp(lain[:, 2]) < 0.01
    assert np.ptp(lain[:, 0]) == pytest.approx(np.ptp(vertices[:, 0]), abs=0.02)


def test_warp_prints_nothing_when_the_package_simulates_and_draws():
    code = """
import numpy as np
from dgl_physics import ModelBuilder, SolverXPBD, State
from dgl_physics.drawing.mesh import Mesh, SurfaceLook
from dgl_physics.drawing.camera import PinholeCamera
from dgl_physics.drawing.rasteriser import Rasteriser
vertices, faces = np.eye(3), np.array([[0, 1, 2]])
builder = ModelBuilder()
builder.add_garment(vertices, faces)
model = builder.build()
SolverXPBD(model).step(State(model))
mesh = Mesh(vertices=vertices, normals=vertices, faces=faces, surface=SurfaceLook(), segment=1)
camera = PinholeCamera.aim([0, 0, 0], [1, 1, 1], [1, -1, 0], distance=3, half_width=1, size=(4, 4))
Rasteriser([mesh]).draw(camera)
import warp
assert warp.config.log_level == warp.LOG_INFO
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == ""
