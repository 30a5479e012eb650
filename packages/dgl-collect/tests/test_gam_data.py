"""Training data of the affordance model: views, states and resumed runs."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from safetensors.numpy import load_file

from dgl_assets import MeshingError, garment_ids, list_categories, load_garment
from dgl_collect.errors import OutputFolderError
from dgl_collect.gam_data import DataConfig, Made, generate, generate_data, list_garments
from dgl_collect.gam_data import garment as garment_module
from dgl_collect.gam_data.garment import Entry, find_path, make_garment_data
from dgl_collect.gam_data.motions import FOLDS, PAIRS, make_arc, make_fling
from dgl_collect.gam_data.simulation import GarmentSimulation, find_grip
from dgl_collect.gam_data.views import TOLERANCE, make_direction, see_surface
from dgl_collect.workers import JobOutcome
from dgl_gam.data import read_garment
from dgl_physics import PhysicsError

SCARF, GLOVE = "Scarf/000000", "Glove/000000"
SPACING = garment_module.SPACING
UP = np.array([0.0, 0.0, 1.0])


@pytest.fixture(scope="module", autouse=True)
def coarse():
    """Simulate garments of a third of the particles."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(garment_module, "SPACING", 0.025)
        yield


@pytest.fixture(scope="module")
def top():
    return load_garment("Tops_LongSleeve/000000", spacing=0.025)


def make(garment_id, folder, *, seed=0, is_flat=False):
    entry = Entry(id=garment_id, split="train", is_flat=is_flat)
    return make_garment_data(entry, seed=seed, path=find_path(folder, garment_id))


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    folder = tmp_path_factory.mktemp("data")
    for garment_id in (SCARF, GLOVE):
        made = make(garment_id, folder)
        assert not made.error
    return folder


def find_depths(vertices, faces, eye, points):
    """Compute distances along rays to triangles, shape (N, F); infinite for a miss.

    By Moeller and Trumbore's test.
    """
    ray = points - eye
    ray /= np.linalg.norm(ray, axis=1, keepdims=True)
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    across = np.cross(ray[:, None], (c - a)[None])
    determinant = np.einsum("fk,nfk->nf", b - a, across)
    with np.errstate(divide="ignore", invalid="ignore"):
        u = np.einsum("fk,nfk->nf", eye - a, across) / determinant
        other = np.cross(eye - a, b - a)
        v = ray @ other.T / determinant
        depth = np.einsum("fk,fk->f", c - a, other) / determinant
        is_hit = (u >= 0) & (v >= 0) & (u + v <= 1)
    return np.where(is_hit, depth, np.inf)


def is_same(first, second):
    """Compare the arrays of two files; the order of metadata may differ."""
    a, b = load_file(first), load_file(second)
    assert set(a) == set(b)
    return all(np.array_equal(a[name], b[name]) for name in a)


# Views -------------------------------------------------------------------------------------


@pytest.mark.parametrize(("azimuth", "elevation"), [(0.0, 90.0), (40.0, 50.0), (-150.0, 45.0)])
def test_a_visible_point_is_on_its_triangle_and_nothing_is_before_it(top, azimuth, elevation):
    vertices = top.vertices.astype(np.float64)
    vertices[:, 2] += 0.05 * np.sin(8 * vertices[:, 0])  # not in a plane
    direction = make_direction(np.radians(azimuth), np.radians(elevation))
    view = see_surface(vertices, top.faces, direction, np.random.default_rng(0), count=200)
    corners = vertices[top.faces[view.faces]]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    away = np.abs(((view.points - corners[:, 0]) * normals).sum(axis=1))
    assert away.max() < 1e-6
    distance = np.linalg.norm(corners - view.points[:, None], axis=2)
    nearest = top.faces[view.faces, distance.argmin(axis=1)]
    np.testing.assert_array_equal(view.vertices, nearest)
    assert distance.min(axis=1).max() < 0.025
    eye = (vertices.min(axis=0) + vertices.max(axis=0)) / 2 + 6.75 * direction
    depths = find_depths(vertices, top.faces, eye, view.points)
    ahead = np.linalg.norm(view.points - eye, axis=1) - depths.min(axis=1)
    # Along the ray, what is before a point is the inside of a layer that a seam joins to the
    # point's.
    assert ahead.max() < 1.01 * TOLERANCE
    towards = (normals * (eye - view.points)).sum(axis=1)
    assert (towards > 0).mean() > 0.85  # the rest is the inside, seen through openings


def test_the_back_of_a_garment_lying_flat_is_not_seen_from_above(top):
    vertices = top.vertices.astype(np.float64)
    view = see_surface(vertices, top.faces, UP, np.random.default_rng(1))
    layers = top.face_layers[view.faces]
    behind = view.points[layers < 0]
    assert len(behind) < 0.1 * len(layers)
    # Only where the front has an opening: above the neckline of the front.
    if len(behind):
        eye = (vertices.min(axis=0) + vertices.max(axis=0)) / 2 + 6.75 * UP
        front = top.faces[top.face_layers > 0]
        assert np.isinf(find_depths(vertices, front, eye, behind)).all()
    below = see_surface(vertices, top.faces, -UP, np.random.default_rng(1))
    assert (top.face_layers[below.faces] < 0).mean() > 0.95


def test_a_nearer_sheet_hides_a_farther_one():
    square = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], float)
    low = np.column_stack([square, np.zeros(4)])
    high = np.column_stack([0.5 * square, np.full(4, 0.1)])
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    both = np.concatenate([faces, faces + 4])
    vertices = np.concatenate([low, high])
    view = see_surface(vertices, both, UP, np.random.default_rng(0), distance=50.0)
    covered = (view.points[:, :2] < 0.49).all(axis=1)
    free = (view.points[:, :2] > 0.51).any(axis=1)
    assert (view.faces[covered] >= 2).all()
    assert (view.faces[free] < 2).all()
    assert covered.mean() == pytest.approx(0.24, abs=0.04)


def test_what_cannot_be_seen_is_refused(top):
    square = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0]])
    with pytest.raises(ValueError, match="edge on"):
        see_surface(square, np.array([[0, 1, 2]]), make_direction(0, 0), np.random.default_rng(0))
    with pytest.raises(ValueError, match="camera must be outside"):
        see_surface(top.vertices, top.faces, UP, np.random.default_rng(0), distance=0.0)


# States ------------------------------------------------------------------------------------


def test_an_arc_keeps_the_distance_to_the_line_and_ends_on_the_other_side():
    held = np.array([[0.5, 0.1, 0.0], [0.4, -0.1, 0.0]])
    way = make_arc(held, np.array([0.2, 0.0, 0.0]), 0.0, speed=0.8)
    np.testing.assert_allclose((held + way[-1])[:, 0], [-0.1, 0.0], atol=1e-9)
    np.testing.assert_allclose(way[..., 1], 0.0, atol=1e-12)
    radius = np.hypot(held[:, 0] + way[..., 0] - 0.2, way[..., 2])
    assert (radius < held[:, 0] - 0.2 + 0.031).all()
    assert np.linalg.norm(np.diff(way, axis=0), axis=2).max() * 60 < 0.8 * 1.6


def test_a_fling_ends_just_above_the_ground():
    way = make_fling(0.9, 0.8, forward=0.4)
    np.testing.assert_allclose(way[0], 0.0)
    np.testing.assert_allclose(way[-1, 0], [0.0, -0.4, 0.04 - 0.9])
    assert way[:, 0, 1].max() == pytest.approx(0.4, abs=1e-3)


def test_every_category_of_cloth_has_its_landmarks():
    assert set(PAIRS) == set(FOLDS) == set(list_categories()[:6])
    for category in PAIRS:
        garment = load_garment(garment_ids(category, "train", count=1)[0], spacing=0.025)
        names = [name for pair in PAIRS[category] for name in pair]
        for fold in FOLDS[category]:
            names += [n.format(side=s) for n in fold.grips + fold.hinge for s in ("left", "right")]
        assert set(names) <= set(garment.landmarks)
        assert all(len(find_grip(garment, name)) > 0 for name in names)


def test_held_vertices_stay_and_the_rest_hangs_below():
    scarf = load_garment(SCARF, spacing=0.025)
    grip = find_grip(scarf, "left_end")
    start = scarf.vertices[:, [2, 1, 0]] * [1.0, 1.0, -1.0] + [0.0, 0.0, 1.5]
    end = GarmentSimulation(scarf).settle(start.astype(np.float64), frames=20, pinned=grip)
    np.testing.assert_allclose(end[grip], start[grip], atol=1e-6)
    assert end[:, 2].max() < start[grip, 2].max() + 0.1


def test_states_are_what_they_are_called(data):
    scarf = read_garment(find_path(data, SCARF))
    names = scarf.header.state_names
    states = dict(zip(names, scarf.states, strict=True))
    assert names[0] == "flat"
    assert {"dropped", "crumpled_0", "crumpled_1", "end_folded", "flung", "over_bar"} < set(names)
    size = {name: np.ptp(x, axis=0) for name, x in states.items()}
    assert size["hung_one"][2] > 0.4 * size["flat"][0]  # held in the middle or at an end
    assert 0.1 < size["hung_two"][2] < 0.8 * size["flat"][0]
    assert size["dropped"][2] < 0.1
    assert np.linalg.norm(size["end_folded"][:2]) < 0.95 * np.linalg.norm(size["flat"][:2])
    assert states["over_bar"][:, 2].max() > 1.6
    for name in ("dropped", "crumpled_0", "crumpled_1", "end_folded", "flung"):
        assert -0.001 < states[name][:, 2].min() < 0.02
    glove = read_garment(find_path(data, GLOVE))
    assert glove.header.state_names == ("flat", "tilted_0", "tilted_1", "pressed")
    assert np.ptp(glove.states[3, :, 2]) < np.ptp(glove.states[0, :, 2])


# Files and runs ----------------------------------------------------------------------------


def test_a_file_is_read_and_its_points_are_near_their_vertices(data):
    for garment_id in (SCARF, GLOVE):
        garment = read_garment(find_path(data, garment_id))
        assert garment.header.garment_id == garment_id
        assert garment.has_canonical
        assert garment.view_points.shape == (len(garment.view_state), 2048, 3)
        assert set(garment.view_state) == set(range(len(garment.states)))
        for view, state in enumerate(garment.view_state):
            vertices = garment.states[state][garment.view_vertices[view]]
            away = np.linalg.norm(garment.view_points[view] - vertices, axis=1)
            assert away.max() < 0.04
        assert find_path(data, garment_id).stat().st_size < 1.1e6


def test_another_seed_makes_other_data(data, tmp_path):
    make(GLOVE, tmp_path, seed=1)
    assert not is_same(find_path(tmp_path, GLOVE), find_path(data, GLOVE))


def test_a_garment_that_fails_has_a_reason_and_no_file(tmp_path, monkeypatch):
    def fail(garment, seed, **_):
        raise PhysicsError("dropped: it burst")

    monkeypatch.setattr(garment_module, "make_states", fail)
    made = make(SCARF, tmp_path)
    assert made.error == "dropped: it burst"
    assert not list(tmp_path.rglob("*"))


def test_all_kinds_of_garments_of_all_categories_come_by_turns():
    config = DataConfig(train=4, test=2, flat=8, flat_test=2)
    listed = list_garments(config)
    assert len({entry.id for entry in listed}) == len(listed) == 9 * 16
    assert len({entry.id.partition("/")[0] for entry in listed[:9]}) == 9
    assert {(entry.split, entry.is_flat) for entry in listed[:54]} == {
        (split, is_flat) for split in ("train", "test") for is_flat in (True, False)
    }
    for entry in listed:
        category = entry.id.partition("/")[0]
        assert entry.id in garment_ids(category, entry.split, count=12)
    own = [entry for entry in listed if entry.id.startswith("Scarf/") and entry.split == "train"]
    assert [e.id for e in own if not e.is_flat] == list(garment_ids("Scarf", "train", count=4))
    assert sum(e.is_flat for e in own) == 8


def test_a_flat_garment_is_the_flat_state_of_the_whole_one(data, tmp_path):
    made = make(GLOVE, tmp_path, is_flat=True)
    assert not made.error
    flat, whole = (read_garment(find_path(folder, GLOVE)) for folder in (tmp_path, data))
    assert flat.header.state_names == ("flat",)
    np.testing.assert_array_equal(flat.states[0], whole.states[0])
    views = whole.get_views("flat")
    np.testing.assert_array_equal(flat.view_points, whole.view_points[views])


def test_a_garment_that_cannot_be_meshed_as_usual_has_other_edges(tmp_path, monkeypatch):
    def load(garment_id, spacing=None):
        if spacing == garment_module.SPACING:
            raise MeshingError("an outline cannot be filled")
        return load_garment(garment_id, spacing=spacing)

    monkeypatch.setattr(garment_module, "load_garment", load)
    made = make(SCARF, tmp_path, is_flat=True)
    assert (made.error, made.note) == ("", "edges of 22 mm: an outline cannot be filled")
    kept = read_garment(find_path(tmp_path, SCARF))
    assert kept.states.shape[1] == len(load_garment(SCARF, spacing=0.022).vertices)
    monkeypatch.setattr(garment_module, "_OTHER_SPACINGS", ())
    failed = make(SCARF, tmp_path, is_flat=True)
    assert failed.error == "an outline cannot be filled"


@pytest.mark.slow
def test_a_run_keeps_files_and_failures_and_resumes(tmp_path, monkeypatch):
    monkeypatch.setattr(garment_module, "SPACING", SPACING)  # other processes make them, too
    out = tmp_path / "data"
    config = DataConfig(categories=("Glove",), train=0, test=0, flat=1)
    make(GLOVE, tmp_path / "here", is_flat=True)
    [made] = generate_data(config, out)
    assert (made.id, made.error) == (GLOVE, "")
    path = find_path(out, GLOVE)
    assert is_same(path, find_path(tmp_path / "here", GLOVE))  # of another process
    before = path.stat().st_mtime_ns
    (out / ".staging" / "Glove-x").mkdir(parents=True)
    [made] = generate_data(config, out, resume=True)
    assert (made.error, made.seconds) == ("", 0.0)
    assert path.stat().st_mtime_ns == before
    assert not (out / ".staging").exists()
    with pytest.raises(ValueError, match="is not empty; add --resume"):
        list(generate_data(config, out))
    for change, message in (
        ({"seed": 1}, "its seed is 0, this run's is 1"),
        ({"flat": 3}, "its flat is 1, this run's is 3"),
    ):
        with pytest.raises(OutputFolderError, match=message):
            list(generate_data(replace(config, **change), out, resume=True))
    path.unlink()
    failure = json.dumps({"id": GLOVE, "reason": "pressed: it burst"})
    (out / "failures.jsonl").write_text(failure + "\n" + '{"id": "unfin', encoding="utf-8")
    [made] = generate_data(config, out, resume=True)
    assert made.error == "pressed: it burst"
    run = json.loads((out / "run.json").read_text(encoding="utf-8"))
    run["versions"]["dgl-physics"] = "0.0.0"
    (out / "run.json").write_text(json.dumps(run), encoding="utf-8")
    with pytest.raises(OutputFolderError, match=r"versions: its dgl-physics is '0\.0\.0'"):
        list(generate_data(config, out, resume=True))


def test_a_failure_of_a_run_is_written_down(tmp_path, monkeypatch):
    def fail(dispatcher):
        for job in dispatcher._left:
            made = Made(id=job.request.id, error="flung: it burst")
            yield JobOutcome(
                job=job, result=made, failure=None, seconds=1.0, folder=tmp_path / "none"
            )

    monkeypatch.setattr(generate.Dispatcher, "run", fail)
    config = DataConfig(categories=("Scarf",), train=1, test=1)
    ids = sorted(made.id for made in generate_data(config, tmp_path))
    lines = (tmp_path / "failures.jsonl").read_text(encoding="utf-8").splitlines()
    found = sorted((json.loads(line) for line in lines), key=lambda entry: entry["id"])
    assert found == [{"id": name, "reason": "flung: it burst"} for name in ids]
    again = list(generate_data(config, tmp_path, resume=True))
    assert [made.seconds for made in again] == [0.0, 0.0]  # known failures are not tried again


def test_wrong_options_are_refused():
    for change, message in (
        ({"categories": ("Scraf",)}, "did you mean Scarf?"),
        ({"train": -1}, "train must be in [0, 8000]; got -1"),
        ({"test": 2001}, "test must be in [0, 2000]; got 2001"),
        ({"train": 7500, "flat": 501}, "flat must be in [0, 500]; got 501"),
        ({"train": 0, "test": 0}, "at least 1 garment must be made"),
        ({"seed": -1}, "seed must not be negative"),
    ):
        with pytest.raises(ValueError, match=re.escape(message)):
            DataConfig(**change)
