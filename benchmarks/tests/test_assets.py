"""Garments are chosen, measured and dropped; a run can be interrupted and continued."""

import json
import multiprocessing
import re
from collections import Counter
from dataclasses import replace

import imageio.v3 as iio
import numpy as np
import pytest

import dgl_bench
from dexgarmentlab.cli import main
from dgl_assets import garment_ids, list_categories, load_garment
from dgl_bench.assets import (
    Attempt,
    RunConfig,
    drop_garments,
    load_run,
    make_rows,
    write_report,
)
from dgl_bench.assets.attempts import find_positions, read_attempts
from dgl_bench.assets.drop import drop_garment
from dgl_bench.assets.measures import (
    compute_smallest_angles,
    describe_mesh,
    find_edges,
    measure_landmarks,
)
from dgl_bench.assets.report import make_table
from dgl_bench.assets.selection import find_partners, select_ids
from dgl_bench.assets.sheets import load_dropped
from dgl_files.whole import append_line

GOOD = Attempt(
    id="Scarf/000001",
    vertices=2000,
    edges=6000,
    faces=4000,
    particles=2000,
    build_seconds=0.2,
    drop_seconds=1.0,
    edge_mean=0.013,
    edge_shortest=0.0081,
    edge_longest=0.0179,
    edge_share=0.995,
    angle_smallest=25.0,
    angle_share=1.0,
    partner="Scarf/000002",
    landmark_miss=0.0,
    landmark="centre",
    strain_start=0.001,
    strain_worst=0.004,
    strain_worst_frame=7,
    frames_over=0,
    strain_end=0.003,
    edge_change=0.1,
    speed=0.0,
    still_seconds=1.5,
    crossings_start=0,
    crossings_end=0,
)


# Selection ---------------------------------------------------------------------------------


def test_the_full_selection_has_all_categories_splits_and_sizes():
    ids = select_ids(2500)
    assert ids == select_ids(2500)
    assert len(set(ids)) == len(ids) == 2500
    counts = Counter(garment_id.partition("/")[0] for garment_id in ids)
    assert set(counts) == set(list_categories())
    assert set(counts.values()) == {277, 278}
    for category in list_categories():
        pools = [
            set(ids) & set(garment_ids(category, split, sizes=sizes))
            for split in ("train", "test")
            for sizes in ("reach", "all")
        ]
        assert [len(pool) for pool in pools] == pytest.approx([69.5] * 4, abs=0.5)


def test_every_part_of_a_run_has_all_categories():
    ids = select_ids(90)
    for start in range(0, 90, 9):
        assert len({i.partition("/")[0] for i in ids[start : start + 9]}) == 9


def test_some_categories_and_few_garments():
    assert select_ids(2, ["Glove", "Scarf"]) == ("Scarf/004000", "Glove/004000")
    assert len(select_ids(7, ["Scarf", "Glove"])) == 7


@pytest.mark.parametrize(
    ("count", "categories", "message"),
    [
        (8, (), "count must be at least 9"),
        (5, ("Scraf",), "did you mean Scarf?"),
        (5, ("x",), "they are: Tops_LongSleeve"),
        (20_000, ("Scarf",), "at most 8000 garments to a category"),
    ],
)
def test_what_cannot_be_selected_is_refused(count, categories, message):
    with pytest.raises(ValueError, match=message):
        select_ids(count, categories)


def test_partners_are_others_of_the_category():
    ids = select_ids(27)
    partners = find_partners(ids)
    assert set(partners) == set(ids)
    assert set(partners.values()) == set(ids)  # each is somebody's
    for own, other in partners.items():
        assert own != other
        assert own.partition("/")[0] == other.partition("/")[0]
    assert find_partners(["Scarf/000003"]) == {"Scarf/000003": "Scarf/000003"}


# Measures ----------------------------------------------------------------------------------


def make_right_triangle(width, height):
    return np.array([[0, 0], [width, 0], [0, height]], float), np.array([[0, 1, 2]])


@pytest.mark.parametrize(
    ("legs", "share"),
    [
        ((0.008, 0.012), 1.0),  # the limits belong to the range
        ((0.0079, 0.012), 2 / 3),
        ((0.0108, 0.0144), 1.0),  # hypotenuse 18 mm
        ((0.011, 0.0144), 2 / 3),
    ],
)
def test_edges_on_both_sides_of_the_limits(legs, share):
    facts = describe_mesh(*make_right_triangle(*legs))
    assert facts.edge_share == pytest.approx(share)
    assert facts.edge_shortest == pytest.approx(min(legs))
    assert facts.edge_longest == pytest.approx(np.hypot(*legs))
    assert facts.edge_mean == pytest.approx((sum(legs) + np.hypot(*legs)) / 3)


@pytest.mark.parametrize(("angle", "share"), [(20.0, 1.0), (19.9, 0.0), (20.1, 1.0), (45.0, 1.0)])
def test_angles_on_both_sides_of_the_limit(angle, share):
    rest, faces = make_right_triangle(0.012, 0.012 * np.tan(np.radians(angle)))
    facts = describe_mesh(np.column_stack([rest, np.zeros(3)]), faces)  # three columns as well
    assert facts.angle_share == share
    assert facts.angle_smallest == pytest.approx(angle)


def test_a_triangle_without_area_has_no_angle():
    rest = np.array([[0, 0], [1, 0], [2, 0], [0, 0], [1, 1]], float)
    assert compute_smallest_angles(rest, np.array([[0, 1, 2], [0, 3, 4]])) == pytest.approx([0, 0])


def test_edges_that_triangles_share_count_once():
    edges = find_edges(np.array([[0, 1, 2], [2, 1, 3]]))
    assert edges.tolist() == [[0, 1], [0, 2], [1, 2], [1, 3], [2, 3]]


def test_landmarks_that_lie_elsewhere_are_found_out():
    source, target = load_garment("Scarf/000001"), load_garment("Scarf/000002")
    miss, _, count = measure_landmarks(source, target)
    assert miss < 1e-3
    assert count == len(source.landmarks)
    name = "left_end"
    start = target.landmarks[name]
    step = target.vertices - target.vertices[start]
    away = int(np.argmin(np.abs(np.linalg.norm(step, axis=1) - 0.05)))
    moved = replace(target, landmarks={**target.landmarks, name: away})
    miss, worst, _ = measure_landmarks(source, moved)
    edge = describe_mesh(target.rest_vertices, target.faces).edge_mean
    assert worst == name
    assert miss == pytest.approx(np.linalg.norm(step[away]) / edge, rel=1e-3)
    with pytest.raises(ValueError, match="no landmark in common"):
        measure_landmarks(source, replace(target, landmarks={}))


# What is whole -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("changes", "fault"),
    [
        ({}, ""),
        ({"strain_worst": 0.01, "edge_change": 0.5}, ""),
        ({"strain_worst": 0.0101}, "mean strain 1.01 % in frame 7, 0.30 % at the end"),
        ({"strain_worst": None}, "mean strain unknown"),
        ({"strain_worst": float("nan")}, "mean strain nan"),
        ({"edge_change": 0.501}, "an edge changed by 50.10 %"),
        ({"edge_change": None}, "an edge changed by unknown"),
        ({"error": "SimulationDivergedError: at frame 3"}, "SimulationDivergedError: at frame 3"),
    ],
)
def test_what_is_whole(changes, fault):
    attempt = replace(GOOD, **changes)
    assert attempt.is_whole == (not fault)
    assert "; ".join(attempt.faults).startswith(fault)


def test_a_strained_garment_is_measured():
    """The rest lengths are shorter than the garment: nothing keeps it whole."""
    scarf = load_garment("Scarf/000001")
    tight = replace(scarf, rest_vertices=scarf.rest_vertices * np.float32(0.8))
    assert drop_garment(tight, frames=1).strain[0] == pytest.approx(0.25, abs=0.01)
    assert drop_garment(scarf, frames=1).strain[0] < 1e-4


def test_garments_fall_and_come_to_rest():
    drop = drop_garment(load_garment("Glove/000001"), frames=70, height=0.03)
    assert drop.error == ""
    assert drop.start[:, 2].min() == pytest.approx(0.03)
    assert 0.0 < drop.end[:, 2].min() < 0.02
    assert len(drop.strain) == 71
    assert drop.strain.max() < 0.01
    assert drop.still_frame is not None
    assert drop.particles == 2 * len(drop.end)  # the inner side too


# Rows --------------------------------------------------------------------------------------


def find_row(rows, name):
    return next(row for row in rows if row.name == name)


def test_rows_of_hand_made_garments():
    torn = replace(
        GOOD, id="Glove/000001", strain_worst=0.03, strain_end=0.002, particles=800,
        edges=2000, edge_share=0.95, landmark_miss=0.6, build_seconds=0.4,
    )  # fmt: skip
    failed = Attempt(id="Glove/000002", error="MeshError: broken")
    rows = make_rows([GOOD, torn, failed])
    found = {row.name: (row.value, row.ok) for row in rows}
    assert found["all.garments"] == (3, None)
    assert found["all.errors"] == (1, False)
    assert found["all.whole"] == (pytest.approx(100 / 3), False)
    assert found["all.whole_at_end"] == (pytest.approx(200 / 3), None)
    assert found["all.strain_worst"] == (pytest.approx(3.0), False)
    # of all edges, not the mean of garments: 6,000 of 99.5 % and 2,000 of 95 %
    assert found["all.edges"] == (pytest.approx((6 * 99.5 + 2 * 95) / 8), False)
    assert found["all.edges_least"] == (pytest.approx(95), None)
    assert found["all.particles"] == (pytest.approx(50), False)
    assert found["all.landmarks"] == (0.6, False)
    assert found["all.build"] == (pytest.approx(0.3), True)
    assert found["Scarf.whole"] == (100, True)
    assert found["Glove.whole"] == (0, False)
    assert found["Glove.at_rest"] == (50, None)


def test_rows_of_one_category_are_not_repeated_and_nothing_is_no_number():
    assert {row.name.partition(".")[0] for row in make_rows([GOOD])} == {"all"}
    assert find_row(make_rows([]), "all.whole").ok is False
    assert find_row(make_rows([]), "all.edges").value is None


# Files -------------------------------------------------------------------------------------


def test_attempts_survive_their_file(tmp_path):
    path = tmp_path / "attempts.jsonl"
    assert read_attempts(path) == []
    failed = Attempt(id="Scarf/000009", error="MeshError: \u2028 line")
    for attempt in (GOOD, failed):
        append_line(path, attempt.to_line())
    assert read_attempts(path) == [GOOD, failed]
    with path.open("a") as file:
        file.write('{"id": "Scarf/0000')  # torn
    assert read_attempts(path) == [GOOD, failed]


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("{}", "line 2: id: field required"),
        ("garbage", "line 2: Invalid JSON"),
        ("[1]", "line 2: should be an object"),
        (GOOD.to_line(), "line 2: Scarf/000001 is there twice"),
    ],
)
def test_damaged_files_are_refused(line, message, tmp_path):
    path = tmp_path / "attempts.jsonl"
    path.write_text(f"{GOOD.to_line()}\n{line}\n")
    with pytest.raises(ValueError, match=message):
        read_attempts(path)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"frames": 0}, "frames must be at least 1"),
        ({"height": 0.0}, "height must be positive"),
        ({"count": 1}, "count must be at least 9"),
        ({"categories": ("Hat",)}, "unknown category 'Hat'"),
    ],
)
def test_wrong_options_are_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        RunConfig(**changes)


@pytest.mark.slow
def test_a_run_is_interrupted_and_continued(tmp_path):
    config = RunConfig(count=3, categories=("Scarf",), frames=2)
    ids = list(select_ids(3, ["Scarf"]))
    running = drop_garments(config, tmp_path, command="first")
    first = next(running)
    assert first.id == ids[0]
    with pytest.raises(ValueError, match="another run is writing"):
        next(drop_garments(config, tmp_path, resume=True))
    for process in multiprocessing.active_children():
        process.kill()  # out of memory, say
    # What was lost is dropped again.
    assert sorted(attempt.id for attempt in running) == sorted(ids[1:])
    assert first in load_run(tmp_path)[1]

    with pytest.raises(ValueError, match="is not empty; add --resume"):
        next(drop_garments(config, tmp_path))
    other = replace(config, frames=3)
    with pytest.raises(ValueError, match="its frames is 2, this run's is 3"):
        next(drop_garments(other, tmp_path, resume=True))

    path = tmp_path / "attempts.jsonl"
    whole = first.to_line() + "\n"
    path.write_text(whole + first.to_line()[:50])  # torn by a power cut
    attempts = list(drop_garments(config, tmp_path, resume=True, command="second"))
    assert [a.id for a in attempts] == ids
    assert path.read_text().startswith(whole)
    content, read = load_run(tmp_path)
    assert read == attempts
    assert content["commands"] == ["first", "second"]
    assert {"dgl-assets", "dgl-physics", "warp-lang"} <= set(content["versions"])
    for attempt in attempts:
        assert attempt.is_whole
        assert np.load(find_positions(tmp_path, attempt.id)).shape == (attempt.vertices, 3)


def test_the_report_of_hand_made_garments(tmp_path):
    """Failures are listed by id with their number; pictures come from where the garments lie."""
    scarf, glove = load_garment("Scarf/000001"), load_garment("Glove/000001")
    strained = replace(GOOD, id="Scarf/000007", strain_worst=0.0234, frames_over=4)
    moving = replace(GOOD, id="Glove/000001", still_seconds=None, speed=0.0125, crossings_end=3)
    failed = Attempt(id="Glove/000002", error="MeshError: a <b> edge")
    for attempt in (GOOD, strained, moving, failed):
        append_line(tmp_path / "attempts.jsonl", attempt.to_line())
    content = {"count": 5, "frames": 300, "versions": {"numpy": "9.9"}, "commands": ["dgl <x>"]}
    (tmp_path / "run.json").write_text(json.dumps(content))
    for garment in (scarf, glove):  # nothing is there of the other scarf
        path = find_positions(tmp_path, garment.name)
        path.parent.mkdir(parents=True)
        np.save(path, garment.vertices)
    drawn = []
    page = write_report(tmp_path, on_picture=lambda: drawn.append(1))
    text = page.read_text()
    assert len(drawn) == 6
    assert "2 of 4</b>garments stay whole" in text
    assert "4 of 5</b>garments dropped" in text
    assert "<td>Scarf/000007</td>" in text
    assert "mean strain 2.34 % in frame 7, 0.30 % at the end" in text
    assert "MeshError: a &lt;b&gt; edge" in text
    assert "12.5 mm/s" in text
    assert "3 edges pierce a triangle; 0 as made" in text
    assert "dgl &lt;x&gt;" in text
    assert "9.9" in text
    for name in re.findall('src="([^"]+)"', text):
        assert np.ptp(iio.imread(tmp_path / name)) > 100
    table = (tmp_path / "table.md").read_text().splitlines()
    assert [line.split(" | ")[0] for line in table] == [
        "| category", table[1], "| Scarf", "| Glove", "| all"
    ]  # fmt: skip
    assert table[2].split(" | ")[1:4] == ["2", "50.0 %", "0"]
    assert table[4].split(" | ")[1:4] == ["4", "50.0 %", "1"]
    assert len({line.count("|") for line in table}) == 1


def test_pictures_of_another_mesh_are_refused(tmp_path):
    append_line(tmp_path / "attempts.jsonl", GOOD.to_line())
    content = {"count": 1, "frames": 300, "versions": {}, "commands": []}
    (tmp_path / "run.json").write_text(json.dumps(content))
    path = find_positions(tmp_path, GOOD.id)
    path.parent.mkdir(parents=True)
    np.save(path, np.zeros((7, 3), np.float32))
    with pytest.raises(ValueError, match=r"as the generator makes Scarf/000001; got \(7, 3\)"):
        write_report(tmp_path)
    with pytest.raises(ValueError, match="holds no positions"):
        load_dropped(tmp_path, replace(GOOD, id="Scarf/000002"))


def test_a_share_is_not_rounded_up_to_all():
    rows = [replace(GOOD, id=f"Scarf/{k:06d}") for k in range(2500)]
    rows[7] = replace(rows[7], strain_worst=0.02)
    assert make_table(rows).splitlines()[2].split(" | ")[1:3] == ["2,500", "99.9 %"]


def test_the_command_is_interrupted(tmp_path, monkeypatch, capsys):
    is_closed = []

    def drop(config, folder, *, stop, **_):
        try:
            yield replace(GOOD, id="Scarf/004000")
            stop.set()  # as Ctrl-C does
        finally:
            is_closed.append(True)

    monkeypatch.setattr(dgl_bench.assets, "drop_garments", drop)
    out = str(tmp_path / "a b")
    words = ["--count", "5", "--category", "Scarf", "--workers", "2", "--json"]
    assert main(["bench", "assets", "--out", out, *words]) == 130
    assert is_closed
    written = capsys.readouterr()
    assert find_row_of(json.loads(written.out), "all.garments")["value"] == 1
    again = f"dgl bench assets --out '{out}' --count 5 --category Scarf --workers 2 --resume"
    assert f"interrupted after 1 of 5 garments; continue with: {again}" in written.err


def find_row_of(rows, name):
    return next(row for row in rows if row["name"] == name)


def test_a_folder_without_a_run_is_no_run(tmp_path):
    with pytest.raises(ValueError, match="holds no run"):
        load_run(tmp_path)
    (tmp_path / "run.json").write_text("{")
    with pytest.raises(ValueError, match="cannot be read"):
        load_run(tmp_path)


@pytest.mark.slow
def test_the_command_writes_rows(tmp_path, capsys):
    out = tmp_path / "drops"
    words = ["--count", "2", "--category", "Scarf", "Glove", "--frames", "3", "--json"]
    assert main(["bench", "assets", "--out", str(out), *words]) == 0
    rows = {row["name"]: row for row in json.loads(capsys.readouterr().out)}
    assert rows["all.garments"]["value"] == 2
    assert rows["all.whole"] == {
        "name": "all.whole", "value": 100.0, "unit": "%", "bar": ">= 100", "ok": True,
        "note": rows["all.whole"]["note"],
    }  # fmt: skip
    assert rows["Glove.particles"]["ok"] is False  # gloves are small
    assert rows["Scarf.landmarks"]["value"] < 1e-3
    command = json.loads((out / "run.json").read_text())["commands"]
    assert command == [f"dgl bench assets --out {out} --count 2 --category Scarf Glove --frames 3"]
    assert main(["bench", "assets", "--out", str(out), *words]) == 1
    assert "is not empty" in capsys.readouterr().err

    assert main(["bench", "assets", "--out", str(out), "--no-drop", "--report", "--json"]) == 0
    written = capsys.readouterr()
    assert {row["name"]: row for row in json.loads(written.out)} == rows
    assert f"report: {out / 'report.html'}" in written.err
    assert len(list((out / "pictures").iterdir())) == 6
