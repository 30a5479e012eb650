"""The verb `assets`."""

import json

import numpy as np
import pytest

from dexgarmentlab.cli import main
from dgl_assets.importing import load_asset

SCARF = "v 0 0 0\nv 120 0 0\nv 120 25 0\nv 0 25 0\nf 1 2 3 4\n"


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
    assert "Scarf, 1.20 x 0.25 x 0.00 m" in text
    assert "licence: CC0" in text
    assert "unit cm, assumed because 1.20 m is the size of a Scarf" in text


def test_the_result_as_json(scarf, tmp_path, capsys):
    assert bring(scarf, "--out", tmp_path / "out", "--json") == 0
    result = json.loads(capsys.readouterr().out)
    (report,) = result["imported"]
    assert result["refused"] == []
    assert report["category"] == "Scarf"
    assert load_asset(report["folder"]).area == pytest.approx(0.3, rel=1e-3)


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
    for name, text in (("a", SCARF), ("b", SCARF.replace("120", "150")), ("c", "v 0 0 0\n")):
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
