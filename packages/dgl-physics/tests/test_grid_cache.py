"""Grids of large meshes are kept on disk, whole or not at all, and give the same distances."""

import numpy as np
import pytest

from dgl_physics import grid_cache
from dgl_physics.collision_mesh import CollisionMesh


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(grid_cache, "LEAST_FACES", 50)
    return grid_cache.get_cache_folder()


@pytest.fixture
def make(meshes):
    """Makes a ball."""

    def make(radius=0.05, **settings):
        vertices, faces = meshes.make_sphere(radius, rings=12, sides=16)
        return CollisionMesh(vertices=vertices, faces=faces, spacing=0.004, **settings)

    return make


def test_a_kept_grid_is_the_one_that_was_built(folder, make, monkeypatch):
    built = make().grid
    (path,) = folder.iterdir()
    monkeypatch.setattr("dgl_physics.collision_mesh.build_distance_grid", pytest.fail)
    read = make().grid
    for name in ("lower", "coarse", "fine_index", "fine"):
        np.testing.assert_array_equal(getattr(read, name), getattr(built, name))
    assert (read.spacing, read.reach) == (built.spacing, built.reach)
    assert path.suffix == ".npz"


def test_another_mesh_or_setting_has_a_grid_of_its_own(folder, make):
    for mesh in (make(), make(0.051), make(reach=0.02), make(is_sheet=True)):
        assert mesh.grid is not None
    assert len(list(folder.iterdir())) == 4


def test_a_small_mesh_is_not_kept(folder, make, monkeypatch):
    monkeypatch.setattr(grid_cache, "LEAST_FACES", 10**6)
    assert make().grid is not None
    assert not folder.exists()


def test_a_damaged_file_is_made_again(folder, make, caplog):
    built = make().grid
    (path,) = folder.iterdir()
    path.write_bytes(path.read_bytes()[:1000])
    np.testing.assert_array_equal(make().grid.fine, built.fine)
    assert "it is made again" in caplog.text
    assert grid_cache._read(path) is not None


def test_a_folder_that_cannot_be_written_is_logged(tmp_path, monkeypatch, caplog, folder, make):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    assert make().grid is not None
    assert "cannot be kept in" in caplog.text
