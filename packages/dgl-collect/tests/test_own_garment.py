"""Garments of one's own in a task: imported, completed by the affordance model, judged."""

import functools
import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image
from scipy.spatial import cKDTree

from dgl_assets import AssetError, load_garment
from dgl_assets.importing import GarmentImportOptions, find_garment, load_asset
from dgl_collect.matching import ExactMatcher
from dgl_collect.own_garment import _digest, prepare_garment
from dgl_tasks import get_task
from dgl_tasks.env import GarmentEnv

TOP = "Tops_LongSleeve/004321"
COARSE = 0.022
"""Edge length that half as many particles have [m]."""


COLOURS = np.array([[[220, 30, 30], [30, 160, 30]], [[30, 30, 220], [230, 220, 30]]], np.uint8)
"""A picture of four fields, by v and u upwards."""


def write_shirt(path, garment):
    """Write a garment in millimetres, with a picture of four fields laid on from above."""
    low, high = garment.vertices.min(axis=0), garment.vertices.max(axis=0)
    uvs = ((garment.vertices - low) / (high - low))[:, :2]
    lines = [f"mtllib {path.stem}.mtl"]
    lines += [f"v {x:.4f} {y:.4f} {z:.4f}" for x, y, z in (1000 * garment.vertices).tolist()]
    lines += [f"vt {u:.5f} {v:.5f}" for u, v in uvs.tolist()] + ["usemtl cloth"]
    lines += [f"f {a}/{a} {b}/{b} {c}/{c}" for a, b, c in (garment.faces + 1).tolist()]
    path.write_text("\n".join(lines) + "\n")
    path.with_suffix(".mtl").write_text(f"newmtl cloth\nmap_Kd {path.stem}.png\n")
    write_picture(path.with_suffix(".png"), COLOURS)


def write_picture(path, fields):
    pixels = fields[::-1].repeat(64, axis=0).repeat(64, axis=1)
    Image.fromarray(pixels).save(path)


@pytest.fixture(scope="module")
def shirt(tmp_path_factory):
    """A shirt of a file in millimetres, and the folder that its import goes to."""
    folder = tmp_path_factory.mktemp("shirt")
    top = load_garment(TOP, spacing=COARSE)
    write_shirt(folder / "shirt.obj", top)
    return folder / "shirt.obj", folder / "kept"


@pytest.fixture(scope="module")
def prepared(shirt):
    coarse = functools.partial(GarmentImportOptions, spacing=COARSE)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("dgl_collect.own_garment.GarmentImportOptions", coarse)
        return prepare_garment(shirt[0], get_task("FoldTops-v1"), folder=shirt[1])


def test_a_file_becomes_a_garment_with_the_places_that_the_rule_needs(prepared):
    garment, known = load_asset(prepared.folder), load_garment(TOP)
    names = get_task("FoldTops-v1").success.landmarks
    assert set(names) <= set(garment.landmarks)
    away = garment.get_landmark_positions(names) - known.get_landmark_positions(names)
    assert np.linalg.norm(away[:, :2], axis=1).max() < 0.05
    assert garment.meta["found_by_affordance_model"] == list(names)
    told = " ".join(prepared.notes)
    assert "unit mm" in told
    assert f"judged by landmarks that the affordance model has found: {', '.join(names)}" in told


def test_a_file_with_another_name_or_picture_is_another_garment(shirt, tmp_path):
    for suffix in (".obj", ".mtl", ".png"):
        shutil.copy(shirt[0].with_suffix(suffix), tmp_path / f"shirt{suffix}")
    assert _digest(tmp_path / "shirt.obj", "Tops_LongSleeve") == _digest(
        shirt[0], "Tops_LongSleeve"
    )
    write_picture(tmp_path / "shirt.png", COLOURS[::-1])
    assert _digest(tmp_path / "shirt.obj", "Tops_LongSleeve") != _digest(
        shirt[0], "Tops_LongSleeve"
    )
    shutil.copy(shirt[0].with_suffix(".png"), tmp_path)
    other = (tmp_path / "shirt.obj").rename(tmp_path / "other.obj")
    assert _digest(other, "Tops_LongSleeve") != _digest(shirt[0], "Tops_LongSleeve")


def test_a_folder_without_a_mesh_is_refused_unread(tmp_path, monkeypatch):
    (tmp_path / "film.mp4").write_bytes(b"large")
    monkeypatch.setattr(Path, "read_bytes", lambda path: pytest.fail(f"{path} is read"))
    with pytest.raises(AssetError, match=f"{tmp_path.name} holds no mesh"):
        prepare_garment(tmp_path, get_task("FoldTops-v1"), folder=tmp_path / "kept")


def test_what_was_prepared_is_not_made_again(prepared, shirt):
    before = {path: path.stat().st_mtime_ns for path in shirt[1].rglob("*")}
    again = prepare_garment(shirt[0], get_task("FoldTops-v1"), folder=shirt[1])
    assert again.folder == prepared.folder
    assert "imported before" in " ".join(again.notes)
    assert "unit mm" in " ".join(again.notes)
    assert {path: path.stat().st_mtime_ns for path in shirt[1].rglob("*")} == before


@pytest.mark.slow
def test_another_picture_makes_another_garment(shirt, tmp_path):
    for suffix in (".obj", ".mtl", ".png"):
        shutil.copy(shirt[0].with_suffix(suffix), tmp_path)
    path, task = tmp_path / "shirt.obj", get_task("FoldTops-v1")
    again = prepare_garment(path, task, folder=shirt[1])
    write_picture(path.with_suffix(".png"), COLOURS[::-1])
    other = prepare_garment(path, task, folder=shirt[1])
    assert other.folder != again.folder
    assert load_asset(other.folder).texture.read_bytes() == path.with_suffix(".png").read_bytes()


def test_key_points_of_ones_own_are_kept(prepared, tmp_path):
    mine = tmp_path / "Tops_LongSleeve" / "mine"
    shutil.copytree(prepared.folder, mine)
    points = json.loads((mine / "keypoints.json").read_text())
    assert prepare_garment(mine, get_task("FoldTops-v1"), folder=tmp_path / "kept").folder == mine
    collar = points.pop("collar")
    points["centre"] = 7
    (mine / "keypoints.json").write_text(json.dumps(points))
    own = prepare_garment(mine, get_task("FoldTops-v1"), folder=tmp_path / "kept")
    assert own.notes == ("judged by landmarks that the affordance model has found: collar",)
    found = load_asset(own.folder)
    assert found.landmarks["centre"] == 7
    assert np.linalg.norm(found.vertices[found.landmarks["collar"]] - found.vertices[collar]) < 0.03
    assert json.loads((mine / "keypoints.json").read_text()) == points


def test_a_folder_without_its_unstrained_shape_is_refused(prepared, tmp_path):
    mine = Path(shutil.copytree(prepared.folder, tmp_path / "mine"))
    (mine / "rest.obj").unlink()
    with pytest.raises(AssetError, match=r"mine/rest\.obj is missing: the garment was laid flat"):
        find_garment(mine)


def test_a_garment_of_another_category_or_none_is_refused(prepared, tmp_path):
    with pytest.raises(ValueError, match=r"must be of category Trousers, which FoldTrousers-v1 is"):
        prepare_garment(prepared.folder, get_task("FoldTrousers-v1"), folder=tmp_path)
    with pytest.raises(ValueError, match=r"garment must be a mesh file .*none\.obj is not there"):
        prepare_garment(tmp_path / "none.obj", get_task("FoldTops-v1"), folder=tmp_path)


@pytest.fixture(scope="module")
def hat(tmp_path_factory):
    """A hat of a file in centimetres, standing on its rim, prepared for its task."""
    folder = tmp_path_factory.mktemp("hat")
    known = load_garment("Bowl_Hat/000005")
    trimesh.Trimesh(known.vertices * 100, known.faces, process=False).export(folder / "hat.obj")
    return prepare_garment(
        folder / "hat.obj", get_task("WearBowlHat-v1"), folder=folder / "kept"
    ).folder


def test_a_hat_keeps_its_shape(hat):
    found, known = load_asset(hat), load_garment("Bowl_Hat/000005")
    assert np.ptp(found.vertices, axis=0) == pytest.approx(
        np.ptp(known.vertices, axis=0), abs=0.004
    )


def test_a_garment_that_cannot_be_simulated_is_refused(hat, tmp_path):
    mine = Path(shutil.copytree(hat, tmp_path / "mine"))
    meta = json.loads((mine / "meta.json").read_text())
    (mine / "meta.json").write_text(json.dumps(meta | {"wall_thickness": 0.05}))
    with pytest.raises(
        ValueError, match=r"mine cannot be simulated: a wall of 0\.05 m folds over itself"
    ):
        prepare_garment(mine, get_task("WearBowlHat-v1"), folder=tmp_path)


def test_the_exact_matcher_knows_the_catalogue_alone(prepared):
    garment = load_asset(prepared.folder)
    with pytest.raises(ValueError, match="take matcher gam for shirt"):
        ExactMatcher(load_garment(TOP), garment, garment.vertices)


@pytest.fixture(scope="module")
def env():
    made = GarmentEnv(
        task="FoldTops-v1", obs_mode="none", sim_backend="physx_cpu", render_backend="cpu"
    )
    yield made
    made.close()


@pytest.mark.render
def test_pictures_show_what_is_printed_on_it(env, prepared):
    env.reset(seed=3, options={"garment": str(prepared.folder)})
    picture = env.take_picture("garment_camera")
    is_garment = picture.segments == env.segments.garment
    points, colours = picture.points[is_garment], picture.rgb[is_garment].astype(float)
    vertex = cKDTree(env.get_particles()).query(points)[1]
    flat = env.garment.vertices[:, :2]
    place = ((flat - flat.min(axis=0)) / np.ptp(flat, axis=0))[vertex]
    within = (np.abs(place - 0.5) > 0.03).all(axis=1)  # not where two fields meet
    u, v = (place[within] > 0.5).T.astype(int)
    expected = COLOURS[v, u].astype(float)
    away = np.linalg.norm(colours[within, None] - COLOURS.reshape(4, 3).astype(float), axis=2)
    nearest = COLOURS.reshape(4, 3)[away.argmin(axis=1)]
    assert len({tuple(c) for c in expected.tolist()}) == 4
    assert (nearest == expected).all(axis=1).mean() > 0.97


@pytest.mark.slow
def test_an_environment_takes_an_id_a_folder_or_a_garment(env, prepared):
    env.reset(seed=3, options={"garment": str(prepared.folder)})
    assert env.draws["garment"] == str(prepared.folder)
    assert 0 <= float(env.evaluate()["success_value"]) < 0.85
    lies = env.get_particles()
    env.reset(seed=3, options={"garment": find_garment(prepared.folder)})
    np.testing.assert_array_equal(env.get_particles(), lies)
    assert env.draws["garment"] == "shirt"
    env.reset(seed=3, options={"garment": TOP})
    assert env.draws["garment"] == TOP
    for options, message in (
        ({"garment": 5}, "a garment must be an id, .* or a folder; got 5"),
        ({"garment": "Trousers/000001"}, "garment must be of category Tops_LongSleeve"),
        ({"garment": str(prepared.folder.parent)}, "is not the folder of an imported garment"),
        ({"garment": "/gone/shirt"}, "there is no garment '/gone/shirt': neither an id"),
        ({"garment": "nope"}, "there is no garment 'nope': neither an id"),
        ({"garmet": TOP}, "options must be among .*garment.*; got .'garmet'"),
    ):
        with pytest.raises((ValueError, AssetError), match=message):
            env.reset(seed=3, options=options)
