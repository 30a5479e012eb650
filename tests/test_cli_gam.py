"""The verbs `train gam`, `gam` and `bench gam`, on a handful of garments of the catalogue."""

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
from safetensors.numpy import save_file

from dexgarmentlab.cli import main
from dexgarmentlab.gam.axes import turn_up
from dexgarmentlab.gam.clouds import load_cloud
from dgl_assets import garment_ids, load_garment
from dgl_collect.gam_data import see_surface
from dgl_gam.data import GarmentFolder, write_garment
from dgl_gam.evaluate import evaluate

CATEGORY = "Trousers"


def write_data(folder: Path, garment_id: str, split: str) -> None:
    garment = load_garment(garment_id, spacing=0.025)
    rng = np.random.default_rng(0)
    vertices = garment.vertices.astype(np.float64)
    views = [see_surface(vertices, garment.faces, np.array([0.0, 0, 1]), rng) for _ in range(2)]
    write_garment(
        folder / f"{garment_id.replace('/', '_')}.safetensors",
        category=garment.category,
        garment_id=garment_id,
        split=split,
        seed=0,
        state_names=["flat"],
        landmark_names=list(garment.landmarks),
        view_directions=np.tile([0.0, 0.0, 1.0], (2, 1)),
        generator_versions={"test": "1"},
        canonical=garment.canonical,
        states=garment.vertices[None],
        faces=garment.faces,
        landmarks=np.array(list(garment.landmarks.values())),
        view_points=np.stack([view.points for view in views]),
        view_vertices=np.stack([view.vertices for view in views]),
        view_state=np.zeros(2, np.int32),
    )


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    folder = tmp_path_factory.mktemp("data")
    for split in ("train", "test"):
        for garment_id in garment_ids(CATEGORY, split, count=2):
            write_data(folder, garment_id, split)
    return folder


@pytest.fixture(scope="module")
def runs(data, tmp_path_factory):
    out = tmp_path_factory.mktemp("out") / "runs"
    assert main(["train", "gam", "--data", str(data), "--out", str(out), "--steps", "1"]) == 0
    return out


@pytest.fixture
def undrawn(monkeypatch):
    """Draw no matches, which takes half a second."""
    monkeypatch.setattr("dexgarmentlab.gam.picture.draw_matches", lambda *_, **__: None)


def test_a_run_is_trained_and_found_again(data, runs, capsys):
    assert (runs / CATEGORY / "network.safetensors").is_file()
    command = ["train", "gam", "--data", str(data), "--out", str(runs), "--steps", "1"]
    assert main(command) == 1
    assert "holds the runs Trousers already; give --resume" in capsys.readouterr().err
    assert main([*command, "--resume", "--json"]) == 0
    (run,) = json.loads(capsys.readouterr().out)["runs"]
    assert run["loss"] is None  # nothing was left to do
    assert run["garments"] == 2


@pytest.mark.slow
def test_all_stages_of_the_shipped_weights_run_with_one_command(
    data, tmp_path, capsys, monkeypatch
):
    """In batches of a few points, which are quicker."""
    from dgl_gam.schedule import SCHEDULES

    shipped = SCHEDULES["shipped"]
    batch = dataclasses.replace(shipped.base.batch, group_size=2, points=256)
    small = dataclasses.replace(shipped, base=dataclasses.replace(shipped.base, batch=batch))
    monkeypatch.setitem(SCHEDULES, "shipped", small)
    stages = shipped.stages
    command = ["train", "gam", "--data", str(data), "--out", str(tmp_path), "--preset", "shipped"]
    command += ["--steps", str(len(stages)), "--json"]
    assert main(command) == 0
    (run,) = json.loads(capsys.readouterr().out)["runs"]
    assert run["network"] == str(tmp_path / "garments" / "network.safetensors")
    assert run["steps"] == len(stages)
    for stage in stages:
        assert (tmp_path / "garments" / stage.name / "network.safetensors").is_file()
    assert main([*command, "--resume"]) == 0
    assert json.loads(capsys.readouterr().out)["runs"][0]["loss"] is None
    assert main([*command, "--resume", "--seed", "1"]) == 1
    assert "begun with other stages" in capsys.readouterr().err


def test_training_of_the_yaw_alone_is_told_by_its_own_loss(data, runs, tmp_path, capsys):
    command = ["train", "gam", "--data", str(data), "--out", str(tmp_path), "--preset", "yaw"]
    command += ["--start", str(runs / CATEGORY / "network.safetensors"), "--steps", "1"]
    assert main(command) == 0
    out = capsys.readouterr().out
    assert "1 steps, cross entropy of the yaw" in out
    assert "InfoNCE" not in out


def test_what_cannot_be_trained_is_said_in_one_line(data, tmp_path, capsys):
    command = ["train", "gam", "--data", str(data), "--out", str(tmp_path)]
    for words, message in (
        (["--preset", "tune"], "name them with --start"),
        (["--preset", "yaw"], "name them with --start"),
        (["--resume"], "holds no run to resume"),
        (["--device", "gpu"], "device must be one that torch can use here"),
        (["--category", "Hat"], "no garments of Hat; it has ['Trousers']"),
        (["--start", str(tmp_path / "none.safetensors")], "none.safetensors cannot be read"),
    ):
        assert main([*command, *words]) == 1
        error = capsys.readouterr().err
        assert message in error
        assert len(error.strip().splitlines()[-1:]) == 1


def test_two_garments_of_the_catalogue_are_matched_and_drawn(runs, tmp_path, capsys):
    picture = tmp_path / "match.png"
    first, second = garment_ids(CATEGORY, "test", count=2)
    words = ["gam", "match", first, second, "--out", str(picture), "--weights", str(runs)]
    assert main([*words, "--landmark", "crotch", "left_knee", "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert [found["point"] for found in result["matches"]] == ["crotch", "left_knee"]
    assert all(0 <= found["confidence"] <= 1 for found in result["matches"])
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert main([*words, "--heat", "3"]) == 0
    assert "confidence" in capsys.readouterr().out
    assert main([*words, "--landmark", "left_ear"]) == 1
    assert "has no landmark left_ear; it has centre" in capsys.readouterr().err
    assert main([*words, "--heat", "8"]) == 1
    assert "--heat must be in [0, 8)" in capsys.readouterr().err


def test_files_of_every_kind_are_clouds(data, runs, tmp_path, capsys, undrawn):
    import trimesh

    points = np.random.default_rng(0).uniform(size=(60, 3)).astype(np.float32)
    np.save(tmp_path / "a.npy", points)
    trimesh.PointCloud(points).export(tmp_path / "a.ply")
    save_file({"points": points}, tmp_path / "a.safetensors")
    for name in ("a.npy", "a.ply", "a.safetensors"):
        np.testing.assert_allclose(load_cloud(str(tmp_path / name)).points, points, atol=1e-6)
    garment = load_cloud(str(next(iter(data.glob("*.safetensors")))))
    assert garment.category == CATEGORY
    assert garment.landmarks is not None
    assert np.linalg.norm(garment.points - garment.landmarks["crotch"], axis=1).min() < 0.03
    words = ["gam", "match", str(tmp_path / "a.npy"), str(tmp_path / "a.ply")]
    words += ["--out", str(tmp_path / "m.png"), "--weights", str(runs)]
    assert main(words) == 1
    assert "name it with --category" in capsys.readouterr().err
    assert main([*words, "--category", CATEGORY]) == 0


def find_crotch(words, capsys):
    """Run `gam match`; where the crotch was found, and what was assumed of B."""
    assert main([*words, "--landmark", "crotch", "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    return np.array(result["matches"][0]["target"]), " ".join(result["assumptions"]["B"])


def test_points_say_which_axis_is_taken_to_be_up(tmp_path, capsys, undrawn):
    """A cloud in centimetres with y up is matched after --up y."""
    shown, seen = "Trousers/008000", load_cloud("Trousers/008001")
    file = tmp_path / "y_up.npy"
    np.save(file, 100 * seen.points[:, [0, 2, 1]] * [1, 1, -1])
    words = ["gam", "match", shown, str(file), "--out", str(tmp_path / "m.png")]
    assert "it is thinnest along y" in find_crotch(words, capsys)[1]
    found, assumed = find_crotch([*words, "--up", "y"], capsys)
    assert "y is taken to be up" in assumed
    assert "thinnest" not in assumed
    assert np.linalg.norm(found - 100 * seen.landmarks["crotch"]) < 4
    assert main([*words, "--up", "x", "y", "z"]) == 1
    assert "--up must be one axis or two; got 3" in capsys.readouterr().err


def test_turning_an_axis_up_keeps_left_and_right():
    for up in ("x", "y", "z", "-x", "-y", "-z"):
        turned = turn_up(np.eye(3), up)
        axis = np.eye(3)["xyz".index(up[-1])] * (-1 if up.startswith("-") else 1)
        np.testing.assert_array_equal(turn_up(axis[None], up)[0], [0, 0, 1])
        assert np.linalg.det(turned) == pytest.approx(1)


@pytest.mark.slow
def test_meshes_of_others_are_brought_into_the_garment_frame(tmp_path, capsys):
    """An OBJ in centimetres, y up; the same faces in a PLY; and the folder of an asset."""
    import trimesh

    from dgl_assets.importing import import_garment

    garment = load_garment("Trousers/008001", spacing=0.02)
    vertices = 100 * garment.vertices.astype(np.float64)[:, [0, 2, 1]] * [1, 1, -1]
    mesh = trimesh.Trimesh(vertices, garment.faces, process=False)
    crotch = garment.vertices[garment.landmarks["crotch"]]
    for name in ("a.obj", "a.ply"):
        mesh.export(tmp_path / name)
    words = ["gam", "match", "Trousers/008000", str(tmp_path / "a.obj")]
    found, assumed = find_crotch([*words, "--out", str(tmp_path / "m.png")], capsys)
    assert "unit cm" in assumed
    assert "up axis y" in assumed
    assert np.linalg.norm(found - crotch) < 0.05
    report = import_garment(tmp_path / "a.obj", out=tmp_path / "assets")
    for path in (report.folder, tmp_path / "a.ply"):
        cloud = load_cloud(str(path))
        assert cloud.category == "Trousers"
        size = np.ptp(cloud.points, axis=0) - np.ptp(garment.vertices, axis=0)
        assert (np.abs(size) < 0.02).all()
    (tmp_path / "b.obj").write_text("v 0 0 0\n")
    words = ["gam", "match", "Trousers/008000", str(tmp_path / "b.obj"), "--out", "m.png"]
    assert main(words) == 1
    assert "b.obj" in capsys.readouterr().err


def test_garments_of_two_categories_do_not_correspond(tmp_path, capsys, undrawn):
    words = ["gam", "match", "Trousers/000001", "Scarf/000001", "--out", str(tmp_path / "m.png")]
    assert main(words) == 1
    assert "A is of Trousers and B of Scarf" in capsys.readouterr().err
    assert not (tmp_path / "m.png").exists()
    assert main([*words, "--category", "Trousers"]) == 0


def test_what_is_no_cloud_is_refused(tmp_path, capsys):
    for name, content, message in (
        ("a.npy", b"rubbish", "is no array of numbers"),
        ("a.ply", b"rubbish", "a.ply"),
        ("a.safetensors", b"rubbish", "cannot be read as safetensors"),
        ("b.npy", None, "does not exist"),
        ("Trousers", None, "or an id such as Trousers/000003"),
    ):
        path = tmp_path / name if "." in name else Path(name)
        if content is not None:
            path.write_bytes(content)
        assert main(["gam", "match", str(path), str(path), "--out", str(tmp_path / "m.png")]) == 1
        assert message in capsys.readouterr().err


def test_clouds_in_which_nothing_can_be_found_are_refused_before_the_model_is_loaded(
    tmp_path, capsys, monkeypatch
):
    from dexgarmentlab.cli.gam_match import MIN_POINTS
    from dgl_gam import model

    assert MIN_POINTS == model.MIN_POINTS
    monkeypatch.setattr("dexgarmentlab.gam.runs.load_models", None)  # It would fail.
    points = np.random.default_rng(0).uniform(size=(40, 3))
    good = tmp_path / "good.npy"
    np.save(good, points)
    points[3] = np.nan
    declared = tmp_path / "declared.npy"
    with declared.open("wb") as file:
        header = {"descr": "<f8", "fortran_order": False, "shape": (10**12, 3)}
        np.lib.format.write_array_header_1_0(file, header)
    for name, array, message in (
        ("none.npy", np.zeros((0, 3)), "must have 16 to 2097152 points; got 0"),
        ("one.npy", np.ones((1, 3)), "must have 16 to 2097152 points; got 1"),
        ("nan.npy", points, "must have finite coordinates; got 1 point(s) that have not, first 3"),
        ("declared.npy", None, "declared.npy"),
        ("many.npy", np.zeros((1_000_001, 3), np.int8), "at most 1,000,000 points; got 1,000,001"),
    ):
        path = tmp_path / name
        if array is not None:
            np.save(path, array)
        for which, words in (("A", [path, good]), ("B", [good, path])):
            command = ["gam", "match", *map(str, words), "--out", str(tmp_path / "m.png")]
            assert main([*command, "--category", CATEGORY]) == 1
            error = capsys.readouterr().err.strip().splitlines()[-1]
            assert message in error
            is_read = name not in ("declared.npy", "many.npy")
            assert not is_read or error.startswith(f"dgl: {which}, {path}, ")


def test_a_picture_that_cannot_be_written_is_told_before_the_match(tmp_path, capsys):
    file = tmp_path / "file"
    file.touch()
    for folder in (file, file / "more"):
        words = ["gam", "match", "Glove/000001", "Glove/000002", "--out", str(folder / "m.png")]
        assert main(words) == 1
        assert capsys.readouterr().err == f"dgl: cannot write to {folder}: Not a directory\n"


def test_weights_that_are_missing_are_said(tmp_path, capsys):
    words = ["gam", "match", "Glove/000001", "Glove/000002", "--out", str(tmp_path / "m.png")]
    assert main([*words, "--weights", str(tmp_path)]) == 1
    assert "has no weights for Glove" in capsys.readouterr().err
    assert main([*words, "--weights", str(tmp_path / "none")]) == 1
    assert "none does not exist" in capsys.readouterr().err
    assert main([*words, "--device", "gpu"]) == 1
    assert "got 'gpu'" in capsys.readouterr().err


def test_networks_are_measured_and_packed(data, runs, tmp_path, capsys, monkeypatch):
    found = []

    def evaluate_and_keep(*args, **options):
        found[:] = evaluate(*args, **options)
        return found

    measured = ["gam", "eval", "--data", str(data), "--weights", str(runs), "--pairs", "1"]
    with monkeypatch.context() as patch:
        patch.setattr("dgl_gam.evaluate.evaluate", evaluate_and_keep)
        assert main([*measured, "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)
    assert [row["condition"] for row in rows] == [
        "flat_30",
        "flat_any",
        "noise_half",
        "noise_cut",
        "noise_any",
        "all",
    ]
    with monkeypatch.context() as patch:  # the same rows, written in other ways
        patch.setattr("dgl_gam.evaluate.evaluate", lambda *_, **__: found)
        assert main([*measured, "--markdown"]) == 0
        assert capsys.readouterr().out.startswith("| category | condition |")
        assert main(measured) == 0
        assert "swap_rate" in capsys.readouterr().out
    packing = ["gam", "pack", "--runs", str(runs), "--data", str(data), "--pairs", "1"]
    packing += ["--calibration-pairs", "2", "--samples", str(tmp_path / "samples")]
    assert main([*packing, "--out", str(tmp_path), "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    (packed,) = result["packed"]
    kept = GarmentFolder(tmp_path / "samples")
    assert sorted(result["samples"]) == sorted(str(header.path) for header in kept.headers)
    assert [header.split for header in kept.headers] == ["test", "test"]
    assert all(len(kept.load(i).get_views("flat")) > 0 for i in range(2))
    assert packed["bytes"] < 1.4e6
    card = (tmp_path / f"{CATEGORY}.md").read_text(encoding="utf-8")
    assert "calibrated on" in card
    assert "| Trousers | flat_any | 1 |" in card
    assert main(["gam", "pack", "--runs", str(data), "--data", str(data), "--out", "x"]) == 1
    assert "holds no finished run" in capsys.readouterr().err


def test_garments_are_registered_without_their_coordinates(data, tmp_path, capsys):
    out = tmp_path / "registered"
    words = ["gam", "skeleton", CATEGORY, "--data", str(data), "--out", str(out), "--steps", "1"]
    assert main([*words, "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["garments"] == len(list(out.glob("*.safetensors"))) == 4
    assert 0 <= result["measured"]["pck05"] <= result["measured"]["pck10"] <= 1
    assert main(words) == 1
    assert "is not empty; choose another --out" in capsys.readouterr().err


def test_the_speed_is_measured_with_a_bar_for_a_pair(capsys, monkeypatch):
    monkeypatch.setattr("dgl_bench.gam._BATCH", 2)
    assert main(["bench", "gam", "--network", "small", "--repeats", "1", "--json"]) == 0
    rows = {row["name"]: row for row in json.loads(capsys.readouterr().out)}
    assert rows["small, pair, cpu"]["bar"] == rows["shipped, pair, cpu"]["bar"] == "<= 40"
    assert rows["shipped, batch of 2, cpu"]["value"] > 0
    assert rows["small, batch of 2, cpu"]["value"] > 0
    assert "small, pair, cuda" in rows or "small, pair, source known, cuda" in rows
    assert not any(name.startswith("paper") for name in rows)
    assert main(["bench", "gam", "--repeats", "0"]) == 1
    assert "must be positive" in capsys.readouterr().err
