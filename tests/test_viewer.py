"""The viewer, without a browser."""

import importlib
import sys
import threading
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from dexgarmentlab.cli import main
from dexgarmentlab.viewer.episode_page import EpisodePage
from dexgarmentlab.viewer.garment_page import GarmentPage, find_nearest
from dexgarmentlab.viewer.scene import pick_colour
from dexgarmentlab.viewer.server import make_server
from dexgarmentlab.viewer.shots import Shots, find_shots
from dgl_assets import correspond, load_garment
from dgl_physics.drawing.mesh import Image, SurfaceLook

COLLECT_TESTS = Path(__file__).parents[1] / "packages/dgl-collect/tests"
TROUSERS = ("Trousers/000001", "Trousers/000002")


@pytest.fixture
def server():
    made = make_server("127.0.0.1", 18080)
    yield made
    made.stop()


def test_a_ray_meets_the_vertex_in_front():
    vertices = np.array([[0, 0, 0], [0, 0, -1], [0.5, 0, 0.2]], dtype=float)
    origin, down = np.array([0, 0, 2.0]), np.array([0, 0, -1.0])
    assert find_nearest(vertices, origin, down) == 0
    assert find_nearest(vertices, np.array([0.45, 0, 2.0]), down) == 2


def test_a_surface_has_one_colour():
    assert pick_colour(SurfaceLook(colour=(1.0, 0.0, 0.5))) == (255, 0, 186)
    pixels = np.array([[[0, 100, 200], [100, 100, 0]]], dtype=np.uint8)
    assert pick_colour(SurfaceLook(image=Image(pixels=pixels))) == (50, 100, 100)


def test_a_picked_point_is_found_exactly_and_by_the_model(server):
    page = GarmentPage(server, *TROUSERS, matcher="exact")
    first, second = map(load_garment, TROUSERS)
    vertex = first.landmarks["left_knee"]
    places = {}
    add = server.scene.add_icosphere

    def note(name, *args, position, **settings):
        places[name] = np.array(position)
        return add(name, *args, position=position, **settings)

    server.scene.add_icosphere = note
    page.pick(vertex)
    assert "exact correspondence" in page.told.content
    shift = page._shown[1][0] - second.vertices[0]
    wanted = correspond(first, first.vertices[vertex : vertex + 1], second)[0] + shift
    np.testing.assert_allclose(places["/found"], wanted, atol=1e-6)
    np.testing.assert_allclose(places["/picked"], page._shown[0][vertex], atol=1e-6)
    page.matcher.value = "gam"
    page.pick(vertex)
    assert "affordance model" in page.told.content
    assert np.linalg.norm(places["/found"] - wanted) < 0.15


def test_garments_of_two_categories_are_not_compared(server):
    with pytest.raises(ValueError, match="one category; got Scarf, Trousers"):
        GarmentPage(server, TROUSERS[0], "Scarf/000000", matcher="exact")
    page = GarmentPage(server, *TROUSERS, matcher="exact")
    page.names[1].value = "Scarf/000000"
    page._reload()
    assert "one category" in page.told.content  # and the garments stay
    assert [garment.category for garment in page._garments] == ["Trousers"] * 2


def make_shots(frames=4):
    rng = np.random.default_rng(0)
    return Shots(
        particles=rng.random((frames, 5, 3), np.float32),
        poses=rng.random((frames, 2, 7), np.float32),
        criteria=rng.random((frames, 1), np.float32),
        names=("share >= 0.85",),
    )


def test_shots_are_taken_once_for_the_content_of_a_file(tmp_path):
    path, taken = tmp_path / "e.h5", []
    path.write_bytes(b"one")

    def take():
        taken.append(1)
        return make_shots()

    first, again = (find_shots(path, tmp_path / "cache", take) for _ in range(2))
    assert len(taken) == 1
    assert again.names == first.names
    for name in ("particles", "poses", "criteria"):
        np.testing.assert_array_equal(getattr(again, name), getattr(first, name))
    path.write_bytes(b"two")
    find_shots(path, tmp_path / "cache", take)
    assert len(taken) == 2


def test_a_time_line_shows_frames_stages_and_clouds(server, monkeypatch):
    monkeypatch.syspath_prepend(str(COLLECT_TESTS))
    fakes = importlib.import_module("dgl_collect_fakes")
    stages = (
        fakes.make_stage(0, frames=2, name="left_sleeve", first_step=5, cloud_step=0),
        fakes.make_stage(1, frames=1, name="right_sleeve", first_step=16, cloud_step=15),
    )
    shown, clouds = [], {}
    view = SimpleNamespace(
        show=lambda particles, poses: shown.append(particles),
        show_points=lambda name, points, colours: clouds.update({name: points}),
    )
    shots = make_shots(5)
    page = EpisodePage(server, view, fakes.make_episode(stages=stages), shots)
    np.testing.assert_array_equal(shown[-1], shots.particles[0])
    assert "between stages" in page.told.content
    page.cloud.value = page.affordance.value = True
    page.slider.value = 2
    page.show()
    np.testing.assert_array_equal(shown[-1], shots.particles[2])
    assert "left_sleeve" in page.told.content
    assert f"| share >= 0.85 | {shots.criteria[2, 0]:.3f} |" in page.told.content
    np.testing.assert_array_equal(clouds["cloud"], stages[0].env_point_cloud[1][:, :3])
    assert clouds["affordance"].shape == (2048, 3)
    page.slider.value = 4
    page.show()
    assert "right_sleeve" in page.told.content


def test_what_cannot_be_viewed_is_told_in_a_line(tmp_path, capsys, monkeypatch):
    table = [
        (["garment", "Trousers/x"], "Trousers/x"),
        (["garment", TROUSERS[0], "--port", "70000"], "--port must be from 0 to 65535; got 70000"),
        (["task", "FoldTop-v1"], "did you mean 'FoldTops-v1'"),
        (["task", "FoldTops-v1", "--seed", "-1"], "--seed must be at least 0; got -1"),
        (["episode", str(tmp_path / "none.h5")], "no episode file at"),
    ]
    for words, message in table:
        assert main(["view", *words]) == 1, words
        assert message in capsys.readouterr().err
    monkeypatch.setitem(sys.modules, "viser", None)
    assert main(["view", "garment", TROUSERS[0]]) == 1
    assert "viser is not installed: pip install 'dexgarmentlab[viewer]'" in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.render
def test_a_task_is_paused_stepped_and_carried_out(server):
    from dexgarmentlab.viewer.task_page import TaskPage
    from dgl_collect.setup import make_setup

    setup = make_setup("HangTops-v1")
    page = TaskPage(server, setup, colour=(200, 80, 60), seed=0)
    steps, may_go = [], threading.Event()
    listen = page.before_step

    def note(command, look):
        steps.append(look().step)
        listen(command, look)
        may_go.set()

    page.before_step = note
    page.pause()
    page.step()  # runs nothing before it has begun
    page.run()
    assert may_go.wait(120)
    page.pause()
    assert not page.join(2)
    count = len(steps)
    assert not page.join(1)
    assert len(steps) == count  # it waits
    page.step()
    assert not page.join(2)
    assert count < len(steps) <= count + 5
    page.run()
    assert page.join(300)
    assert "value" in page.told.content
    page.reset()
    assert page.told.content.startswith("reset: Tops")
    setup.env.close()
