"""The verb `assets`."""

import json
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from PIL import Image

from dexgarmentlab.cli import main
from dgl_assets import build_garments, list_categories, load_garment
from dgl_assets.importing import load_asset

SCARF = "v 0 0 0\nv 100 0 0\nv 100 20 0\nv 0 20 0\nf 1 2 3 4\n"


@pytest.fixture
def scarf(tmp_path):
    path = tmp_path / "scarf.obj"
    path.write_text(SCARF)
    return path


def bring(*words):
    return main(["assets", "import", *map(str, words), "--spacing", "0.02"])


def test_an_import_says_what_it_made_and_assumed(scarf, tmp_path, capsys):
    assert bring(scarf, "--out", tmp_path / "out", "--licence", "CC0") == 0
    text = capsys.readouterr().out
    assert f"imported {tmp_path / 'out' / 'Scarf' / 'scarf'}" in text
    assert "Scarf, 1.00 x 0.20 x 0.00 m" in text
    assert "licence: CC0" in text
    assert "unit cm, assumed because 1.00 m is the size of a Scarf" in text


def test_the_result_as_json(scarf, tmp_path, capsys):
    assert bring(scarf, "--out", tmp_path / "out", "--json") == 0
    result = json.loads(capsys.readouterr().out)
    (report,) = result["imported"]
    assert result["refused"] == []
    assert report["category"] == "Scarf"
    assert load_asset(report["folder"]).area == pytest.approx(0.2, rel=1e-3)


def test_a_refusal_is_one_line_and_a_failure(tmp_path, capsys):
    (tmp_path / "broken.obj").write_text("v 0 0 0\nf 1 2 3\n")
    assert bring(tmp_path / "broken.obj", "--out", tmp_path / "out") == 1
    written = capsys.readouterr()
    assert written.out == ""
    assert written.err.count("\n") == 1
    assert written.err.startswith("dgl: broken.obj, line 2: index 2 is out of range")
    assert not (tmp_path / "out").exists()


def test_wrong_options_are_refused(scarf, tmp_path, capsys):
    assert main(["assets", "import", str(scarf)]) == 2  # no --out
    assert bring(scarf, "--out", tmp_path / "out", "--category", "Socks") == 1
    assert "category must be one of" in capsys.readouterr().err


def test_a_folder_of_many_is_imported_model_by_model(tmp_path, capsys):
    many = tmp_path / "many"
    for name, text in (("a", SCARF), ("b", SCARF.replace("100", "150")), ("c", "v 0 0 0\n")):
        (many / name).mkdir(parents=True)
        (many / name / f"{name}.obj").write_text(text)
    assert bring(many, "--out", tmp_path / "out", "--json") == 1
    written = capsys.readouterr()
    result = json.loads(written.out)
    assert [report["name"] for report in result["imported"]] == ["a", "b"]
    assert "holds no faces" in result["refused"][0]["reason"]
    assert "1 of 3 models were refused" in written.err
    assert bring(many, "--out", tmp_path / "out", "--name", "x") == 1
    assert "--name is for one garment" in capsys.readouterr().err


def test_a_standing_tube_is_laid_flat(tmp_path, capsys):
    """A sleeveless top in the shape of a body, coarse enough to be quick."""
    turn, rows = 2 * np.pi * np.arange(48) / 48, np.arange(25)
    across = np.column_stack([0.20 * np.cos(turn), 0.08 * np.sin(turn)])
    points = [[x, 0.02 * row, z] for row in rows for x, z in across]
    cells = [(r, c) for r in range(24) for c in range(48)]
    side = [(r, c) for r, c in cells if 14 <= r < 23 and (c in (46, 47, 0, 1) or 22 <= c < 26)]
    top = {24 * 48 + c: 24 * 48 + (48 - c) % 48 for c in range(48)}
    joined = {k: min(k, v) for k, v in top.items() if abs(points[k][0]) > 0.09}
    faces = []
    for r, c in sorted(set(cells) - set(side)):
        a, b = r * 48 + c, r * 48 + (c + 1) % 48
        faces.append([joined.get(i, i) for i in (a, a + 48, b + 48, b)])
    used, faces = np.unique(faces, return_inverse=True)
    lines = [f"v {x:.5f} {y:.5f} {z:.5f}" for x, y, z in np.array(points)[used]]
    lines += [f"f {a} {b} {c} {d}" for a, b, c, d in faces.reshape(-1, 4) + 1]
    (tmp_path / "vest.obj").write_text("\n".join(lines))
    arguments = [tmp_path / "vest.obj", "--out", tmp_path / "out", "--category", "Tops_NoSleeve"]
    assert bring(*arguments, "--lay-flat", "--json") == 0
    (report,) = json.loads(capsys.readouterr().out)["imported"]
    garment = load_asset(report["folder"])
    assert report["is_laid_flat"]
    assert np.ptp(garment.rest_vertices[:, 2]) > 0.12
    assert np.quantile(garment.vertices[:, 2], 0.98) - garment.vertices[:, 2].min() < 0.05


def test_the_list_names_every_category_with_its_counts(capsys):
    assert main(["assets", "list"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines[1:]] == list(list_categories())
    assert lines[-1].split()[:5] == ["Glove", "8000", "2000", "0", "17"]
    assert main(["assets", "list", "--json"]) == 0
    entries = json.loads(capsys.readouterr().out)["categories"]
    assert sum(entry["train"] + entry["test"] for entry in entries) >= 2500
    assert entries[0]["paper"] == {"train": 100, "all": 247}


def test_the_list_of_a_category_is_its_ids(capsys):
    assert main(["assets", "list", "Glove", "--subset", "paper"]) == 0
    assert capsys.readouterr().out.split() == [
        f"Glove/{number:06d}" for number in range(8000, 8017)
    ]
    assert main(["assets", "list", "Scarf", "--split", "test", "--json"]) == 0
    assert len(json.loads(capsys.readouterr().out)["ids"]) == 2000
    assert main(["assets", "list", "Glove", "--subset", "paper", "--split", "train"]) == 0
    assert capsys.readouterr().out == ""
    assert main(["assets", "list", "Sock"]) == 1
    assert "unknown category 'Sock'" in capsys.readouterr().err


def measure(picture):
    with Image.open(picture) as image:
        return image.size


@pytest.mark.slow
def test_a_garment_and_a_category_are_shown(tmp_path, capsys):
    out = tmp_path / "pictures" / "cap.png"
    assert main(["assets", "show", "Baseball_Cap/000003", "--out", str(out), "--json"]) == 0
    shown = json.loads(capsys.readouterr().out)
    assert shown["landmarks"] == load_garment("Baseball_Cap/000003").landmarks
    assert measure(out) == (1000, 1000)
    assert main(["assets", "show", "Scarf", "--out", str(out), "--count", "3"]) == 0
    assert capsys.readouterr().out == f"{out}: 3 of Scarf\n"
    assert measure(out) == (600, 200)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["Scarf/000001", "--out", "scarf.jpg"], "--out must be a file .png; got scarf.jpg"),
        (["Scarf/1", "--out", "scarf.png"], "six digits"),
        (["Sock", "--out", "sock.png"], "unknown category 'Sock'"),
        (["Scarf", "--out", "scarf.png", "--count", "0"], "--count must be at least 1; got 0"),
    ],
)
def test_what_cannot_be_shown_is_refused(words, message, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["assets", "show", *words]) == 1
    assert message in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def build(cache, *words):
    return main(["assets", "build", "--cache", str(cache), "--subset", "paper", *words])


def test_a_build_is_resumed(tmp_path, capsys):
    words = ("--category", "Scarf", "Bowl_Hat", "--json")
    assert build(tmp_path, *words, "--count", "2") == 0
    first = json.loads(capsys.readouterr().out)
    assert (first["requested"], first["built"], first["found"]) == (4, 4, 0)
    assert 0 < first["median_seconds"] <= first["longest_seconds"]
    assert build(tmp_path, *words, "--count", "3") == 0
    second = json.loads(capsys.readouterr().out)
    assert (second["status"], second["built"], second["found"]) == ("finished", 2, 4)
    assert len(list(tmp_path.rglob("*.npz"))) == 6
    assert build(tmp_path, "--category", "Scarf", "--split", "test") == 0
    assert "0 of 0 garments built" in capsys.readouterr().out


def test_a_failure_is_named_and_the_rest_is_built(tmp_path, capsys):
    torn = tmp_path / "Scarf" / "000001.npz"
    torn.parent.mkdir()
    torn.write_bytes(b"PK torn")
    assert build(tmp_path, "--category", "Scarf", "--count", "3") == 1
    written = capsys.readouterr()
    assert "2 of 3 garments built, 0 were there, 1 failed" in written.out
    assert "dgl: Scarf/000001: CacheError:" in written.err
    assert build(tmp_path, "--category", "Scarf", "--count", "0") == 1
    assert "--count must be at least 1" in capsys.readouterr().err
    assert build(tmp_path, "--category", "Scarf", "--workers", "0") == 1
    assert "workers must be at least 1; got 0" in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="sends SIGINT to a process group")
@pytest.mark.usefixtures("heeds_interrupts")
def test_an_interrupted_build_leaves_whole_files_and_says_how_to_go_on(tmp_path):
    words = ["assets", "build", "--category", "Glove", "--workers", "2", "--cache", str(tmp_path)]
    code = "import sys; from dexgarmentlab.cli import main; sys.exit(main())"
    process = subprocess.Popen(
        [sys.executable, "-c", code, *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    try:
        deadline = time.monotonic() + 60
        while len(list(tmp_path.rglob("*.npz"))) < 3 and time.monotonic() < deadline:
            time.sleep(0.05)
        os.killpg(process.pid, signal.SIGINT)  # as Ctrl-C does: to the workers too
        out, err = process.communicate(timeout=60)
    finally:
        process.kill()
    assert process.returncode == 130
    assert "of 10000 garments built" in out
    assert "Traceback" not in err
    assert "interrupted; continue with: dgl assets build " in err
    assert "--category Glove" in err
    files = sorted(tmp_path.rglob("*.*"))
    assert {path.suffix for path in files} == {".npz"}
    ids = [f"Glove/{path.stem}" for path in files]
    assert all(built.error is None and built.is_cached for built in build_garments(ids, tmp_path))


def test_materials_are_drawn_and_their_maps_written(tmp_path, capsys):
    out, maps = tmp_path / "sheet.png", tmp_path / "maps"
    words = ["assets", "materials", "--seed", "3", "--fabrics", "2", "--floors", "1"]
    assert main([*words, "--out", str(out), "--maps", str(maps), "--size", "64", "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert [row["id"] for row in result["materials"]] == ["fabric_00", "fabric_01", "floor_00"]
    assert out.stat().st_size > 10_000
    assert len(list(maps.iterdir())) == 9
    for row in result["materials"]:
        assert row["name"]
        assert row["tile_size"] > 0
        with Image.open(row["maps"]["normal"]) as image:
            assert image.size == (64, 64)
    assert main([*words, "--out", str(tmp_path / "sheet.jpg")]) == 1
    assert "--out must be a file .png" in capsys.readouterr().err
    assert main(["assets", "materials", "--out", str(out), "--fabrics", "-1"]) == 1
    assert capsys.readouterr().err == "dgl: --fabrics must not be negative; got -1\n"


def test_props_are_drawn_and_their_meshes_written(tmp_path, capsys):
    out, meshes = tmp_path / "props.png", tmp_path / "meshes"
    words = ["assets", "props", "--out", str(out), "--kinds", "hanger", "pothook"]
    assert main([*words, "--meshes", str(meshes), "--no-landmarks", "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    hanger, pothook = result["props"]
    assert (hanger["kind"], pothook["kind"]) == ("hanger", "pothook")
    assert hanger["landmarks"]["target"] == [0.0, 0.0, 0.8]
    assert pothook["shapes"] == ["box", "box", "box"]
    assert out.stat().st_size > 5_000
    assert {p.name for p in meshes.iterdir()} == {
        f"{kind}.{end}" for kind in ("hanger", "pothook") for end in ("obj", "mtl")
    }
    assert main(["assets", "props", "--out", str(out), "--kinds", "shelf"]) == 1
    assert "prop must be one of" in capsys.readouterr().err
