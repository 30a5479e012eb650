"""Options of `assets import` and `import-robot`, and hints that name their flags."""

import zipfile

import pytest

pytest.importorskip("dexgarmentlab", reason="the command line is another package")

from dexgarmentlab.cli import main
from dexgarmentlab.cli.assets_import import name_flags

SCARF = "v 0 0 0\nv 100 0 0\nv 100 20 0\nv 0 20 0\nf 1 2 3 4\n"
APART = "o Red\n" + SCARF + "o Blue\nv 0 0 9\nv 130 0 9\nv 130 27 9\nv 0 27 9\nf 5 6 7 8\n"


def run(*words):
    return main(["assets", "import", *map(str, words), "--spacing", "0.02"])


def test_parameters_in_messages_become_flags():
    text = "give `units` or `object`, or import without pictures: `textures=False`; f`x"
    assert name_flags(text) == (
        "give --units or --object, or import without pictures: --no-textures; f`x"
    )


def test_an_object_is_chosen_as_the_message_says(tmp_path, capsys):
    path, out = tmp_path / "scarves.obj", tmp_path / "out"
    path.write_text(APART)
    assert run(path, "--out", out) == 1
    assert "choose one with --object: Blue (63.7%), Red (36.3%)" in capsys.readouterr().err
    assert run(path, "--out", out, "--object", "Blue") == 0
    assert "1.30 x 0.27" in capsys.readouterr().out
    assert run(path, "--out", out, "--object", "Red") == 1
    assert "or replace it: --overwrite" in capsys.readouterr().err
    assert run(path, "--out", out, "--object", "Red", "--overwrite", "--weld", "0.0005") == 0
    assert "1.00 x 0.20" in capsys.readouterr().out


def test_a_mesh_of_an_archive_is_chosen_as_the_message_says(tmp_path, capsys):
    path, out = tmp_path / "two.zip", tmp_path / "out"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("source/red.obj", SCARF)
        archive.writestr("source/blue.obj", SCARF)
    assert run(path, "--out", out) == 1
    assert "choose one with --mesh: source/blue.obj, source/red.obj" in capsys.readouterr().err
    assert run(path, "--out", out, "--mesh", "source/red.obj") == 0


def test_a_missing_picture_names_the_flag_that_does_without(tmp_path, capsys):
    path, out = tmp_path / "red.obj", tmp_path / "out"
    path.write_text("mtllib red.mtl\nvt 0 0\n" + SCARF.replace("f 1 2 3 4", "f 1/1 2/1 3/1 4/1"))
    assert run(path, "--out", out) == 1
    assert "import without pictures: --no-textures" in capsys.readouterr().err
    assert run(path, "--out", out, "--no-textures") == 0


def test_an_existing_robot_names_the_flag_that_replaces_it(tmp_path, capsys):
    (tmp_path / "robots" / "mine").mkdir(parents=True)
    (tmp_path / "r.urdf").write_text("<robot/>")
    words = ["assets", "import-robot", str(tmp_path / "r.urdf"), "--name", "mine", "--kind", "arm"]
    assert main([*words, "--robots", str(tmp_path / "robots")]) == 1
    assert "choose another --name, or replace it: --overwrite" in capsys.readouterr().err
