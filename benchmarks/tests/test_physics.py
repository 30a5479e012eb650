"""The physics bench: rows, registry, pictures, reports, and its quick experiments for real."""

import numpy as np
import pytest

import dgl_bench.physics
from dgl_bench.physics import (
    Bench,
    Experiment,
    Reading,
    Result,
    cpu_code,
    equal_strain,
    speed_scenes,
)
from dgl_bench.physics.against_newton import Setting, hang_here
from dgl_bench.physics.drawing import save_figure
from dgl_bench.physics.fabrics import compute_elastica
from dgl_bench.physics.figures import Bars, Chart, ClothView, Figure, Limit, Series
from dgl_bench.physics.hat import measure_change, press_hat
from dgl_bench.physics.panel import HungPanel
from dgl_bench.physics.peirce import compute_chord_angle
from dgl_bench.physics.rendering import measure_extent, render
from dgl_bench.physics.selfcontact import measure_gaps
from dgl_bench.physics.sheets import (
    join,
    make_bowl,
    make_box,
    make_capsule,
    make_panel,
    make_sheet,
)
from dgl_bench.physics.solids import stretch_bar
from dgl_bench.physics.speed_scenes import SpeedScene, make_hanging
from dgl_physics import ModelBuilder, SimulationDivergedError, SolverConfig
from dgl_physics.launcher import find_vector_obstacle
from dgl_physics.measure import find_intersections
from dgl_physics.scene import Scene
from dgl_physics.tetrahedra import check_orientation
from dgl_physics.topology import check_mesh, compute_edges


def test_a_row_is_judged_on_both_sides_of_its_bar():
    for bar, values in (("<= 10", (10.0, 10.1)), (">= 10", (10.0, 9.9))):
        assert [Reading("", v, "", bar=bar).ok for v in values] == [True, False]
    assert Reading("", None, "", bar="<= 1e-4").ok is False  # it failed
    assert Reading("", 1.0, "").ok is None


def test_a_skipped_row_says_why_and_is_neither_met_nor_missed():
    row = Reading.skip("", "mm", "no CUDA", bar="<= 2")
    assert row.ok is None
    assert row.to_dict()["note"] == "no CUDA"


@pytest.mark.parametrize("bar", ["< 2", "about 2", "<= two"])
def test_a_bar_that_cannot_be_compared_is_refused(bar):
    with pytest.raises(ValueError, match=r"bar must|could not convert"):
        Reading("", 1.0, "", bar=bar)


def test_experiments_are_chosen_by_name_and_keep_their_order():
    assert [e.name for e in dgl_bench.physics.select(("panel", "free_fall"))] == [
        "free_fall",
        "panel",
    ]
    assert len(dgl_bench.physics.select()) == len(dgl_bench.physics.EXPERIMENTS)
    with pytest.raises(ValueError, match=r"unknown experiment 'panels'; did you mean panel\?"):
        dgl_bench.physics.select(("panels",))


def test_the_effort_scales_repetitions():
    assert [Bench(effort=e).scale(50, least=2) for e in (1.0, 0.5, 0.001)] == [50, 25, 2]
    with pytest.raises(ValueError, match="effort must be > 0; got 0"):
        Bench(effort=0)


def test_the_panel_is_one_sewn_surface():
    panel = HungPanel()
    check_mesh(panel.vertices, panel.faces)
    assert len(panel.vertices) >= 3500
    width, _, height = np.ptp(panel.vertices, axis=0)
    assert (width, height) == pytest.approx((0.6, 0.7), abs=0.013)
    assert np.ptp(panel.vertices[list(panel.pinned)][:, 0]) == pytest.approx(0.6, abs=0.02)
    # flat rest lengths are those of even triangles, so nothing is strained where layers meet
    _, faces, rest = make_panel(0.1, 0.1, 0.0125, gap=0.008)
    ends = rest[compute_edges(faces)]
    assert np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1) == pytest.approx(0.0125)
    assert len(find_intersections(panel.vertices, panel.faces)) == 0


def test_nearer_triangles_cover_those_behind():
    near, faces = make_sheet(0.1, 0.1, 0.0125)
    far = near - [0, 0, 0.01]
    values = np.repeat([1.0, 0.0], len(faces))
    vertices, both = join([(near, faces), (far, faces)])
    for elevation, expected in ((90.0, 1.0), (-90.0, 0.0)):
        picture = ClothView("", vertices, both, elevation=elevation, values=values, value_limit=1.0)
        low, high = measure_extent(picture)
        image = render(
            picture,
            centre=(low + high) / 2,
            half=(0.06, 0.06),
            width=60,
            colour_map=lambda v: np.column_stack([v, 1 - v, v * 0, v * 0 + 1]),
        )
        seen = image[30, 30]
        assert (seen[0] > seen[1]) == bool(expected)
        assert seen[3] == 1.0
        assert image[0, 0, 3] == 0.0


def test_a_bowl_is_half_a_sphere_and_a_box_is_closed():
    vertices, faces = make_bowl(0.09, 11)
    check_mesh(vertices, faces)
    assert len(vertices) == 1 + 3 * 11 * 12
    assert not check_orientation(faces)
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    assert (np.sum(normal * (a + b + c), axis=1) > 0).all()  # seen from outside
    area = 0.5 * np.linalg.norm(normal, axis=1).sum()
    assert area == pytest.approx(2 * np.pi * 0.09**2, rel=0.02)
    vertices, faces = make_box((0.1, 0.2, 0.3))
    assert check_orientation(faces)
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    assert np.sum(a * np.cross(b, c)) / 6 == pytest.approx(0.1 * 0.2 * 0.3)


@pytest.mark.parametrize("overhang", [0.5, 2.0, 3.5])
def test_the_elastica_has_the_chord_of_peirces_test(overhang):
    shape = compute_elastica(overhang)
    out, up = shape[-1]
    assert np.arctan2(-up, out) == pytest.approx(float(compute_chord_angle(overhang)), rel=1e-3)
    lengths = np.linalg.norm(np.diff(shape, axis=0), axis=1)
    assert lengths.sum() == pytest.approx(overhang)


def test_gaps_match_brute_force():
    vertices, faces = make_sheet(0.1, 0.1, 0.0125)
    x = vertices + np.random.default_rng(0).normal(0, 0.008, vertices.shape)
    gaps = measure_gaps(x, faces, reach=0.015)
    distance = np.linalg.norm(x[:, None] - x[None], axis=2)
    np.fill_diagonal(distance, np.inf)
    for k in range(3):
        distance[faces[:, k], faces[:, k - 1]] = distance[faces[:, k - 1], faces[:, k]] = np.inf
    nearest = distance.min(axis=1)
    assert np.isinf(gaps[nearest > 0.015 + 1e-6]).all()
    inside = nearest < 0.015 - 1e-6
    assert inside.sum() > 20
    assert gaps[inside] == pytest.approx(nearest[inside], abs=1e-6)


def test_change_of_shape_knows_no_rigid_motion_and_sees_one_particle():
    rest = np.random.default_rng(0).normal(size=(50, 3))
    turn = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    turn *= np.linalg.det(turn)
    assert measure_change(rest @ turn + [1, 2, 3], rest).max() < 1e-12
    assert measure_change(rest * [-1, 1, 1], rest).max() > 0.1  # a mirror image is another shape
    moved = rest.copy()
    moved[7, 0] += 0.01
    assert measure_change(moved, rest)[7] == pytest.approx(0.01, rel=0.05)


def test_a_bar_in_tension_shows_the_modulus_it_was_given():
    bar = stretch_bar(1e6, 0.0)
    assert bar.error == pytest.approx(0.0, abs=0.02)
    assert bar.strain.max() == pytest.approx(0.02, rel=0.1)


def test_a_hat_is_squeezed_and_finds_back():
    record = press_hat(rings=7)
    worn, pressed, released, off = record.moments
    assert pressed.change.max() > 4.0 > 3.0 > released.change.max()
    assert worn.change.max() < 2.0
    assert off.change.max() < 0.05
    force = record.path[released.frame - 1][2]
    assert force == pytest.approx(record.weight, rel=0.01)


def _figure():
    vertices, faces = make_sheet(0.1, 0.1, 0.0125)
    return Figure(
        "all_kinds",
        "Every <kind> of panel.",
        (
            ClothView(
                "sheet",
                vertices,
                faces,
                values=np.linspace(0, 1, len(faces)),
                value_label="[%]",
                solids=[make_capsule(np.zeros(3), np.array([0.0, 0, 0.05]), 0.01)],
                marks=vertices[:2],
            ),
            Chart(
                "curves",
                "x",
                "y",
                [
                    Series([1, 2], [1, 3], kind, kind=kind)
                    for kind in ("theory", "measured", "line", "faint")
                ],
                limits=(Limit(2.0), Limit(1.5, is_vertical=True, is_quiet=True)),
                is_log_y=True,
            ),
            Bars("bars", ("a", "b"), (1.0, 2000.0), "ms", expected=(1.1, 1900.0)),
        ),
    )


def test_a_figure_is_a_small_picture(tmp_path):
    path = save_figure(_figure(), tmp_path)
    assert path.read_bytes()[:4] == b"\x89PNG"
    assert path.stat().st_size < 120_000


@pytest.mark.parametrize("name", ["free_fall", "incline", "fabrics"])
def test_theory_holds_where_it_is_met_today(name):
    [(_, result, seconds)] = dgl_bench.physics.run(dgl_bench.physics.select((name,)), Bench())
    assert [row.ok for row in result.rows] == [True] * len(result.rows)
    assert seconds > 0
    assert all(
        np.isfinite(np.asarray(c.y)).all() for f in result.figures for c in f.panels[0].curves
    )


def test_a_simulation_that_fails_is_a_row_and_the_next_follows():
    def fail(bench):
        raise SimulationDivergedError(7, [0])

    rows = (Reading("fine", 1.0, ""),)
    experiments = [
        Experiment("bad", "Bad", "", fail),
        Experiment("good", "Good", "", lambda bench: Result(rows)),
    ]
    results = [result for _, result, _ in dgl_bench.physics.run(experiments, Bench())]
    assert results[0].rows[0].ok is False
    assert "diverged at frame 7" in results[0].rows[0].note
    assert results[1].rows == rows


def test_newton_that_is_not_there_is_said_with_the_fix(monkeypatch):
    import sys

    from dgl_bench.physics import against_newton

    monkeypatch.setattr(against_newton, "FRAMES", 3)
    result = against_newton.measure_newton(Bench(newton_python=f"{sys.prefix}/bin/no-such-python"))
    skipped = [row for row in result.rows if row.is_skipped]
    assert len(skipped) == 2
    assert all(
        "pip install newton" in row.note and "--newton-python" in row.note for row in skipped
    )


def _make_patch(frames, *, first_timed=0):
    """A patch that falls onto the ground and sleeps there."""
    vertices, faces = make_sheet(0.05, 0.05, 0.0125)
    vertices[:, 2] += 0.2

    def build(config):
        builder = ModelBuilder()
        builder.add_garment(vertices, faces)
        builder.add_ground()
        scene = Scene(builder, config)
        return scene.solver, scene.state

    return SpeedScene(
        name="patch, frame",
        note="",
        build=build,
        play=lambda solver, state, frame: solver.step(state),
        frames=frames,
        first_timed=first_timed,
        config=SolverConfig(sleep_after=0.1),
    )


@pytest.mark.skipif(find_vector_obstacle() is not None, reason="this CPU runs no vector code")
def test_both_codes_are_timed_on_the_same_frames_that_are_awake():
    found = cpu_code.compare_codes(_make_patch(40, first_timed=5))
    assert 5 < len(found.vector) == len(found.warp) < 35  # it lies still in the end
    assert min(found.vector.min(), found.warp.min()) > 0
    rows = cpu_code.make_rows(_make_patch(40), found)
    assert rows[2].value == pytest.approx(found.warp.mean() / found.vector.mean())
    assert (rows[3].value, rows[3].ok) == (0, True)


def test_a_cpu_without_vector_code_is_skipped_with_the_reason(monkeypatch):
    monkeypatch.setattr(cpu_code, "find_vector_obstacle", lambda: "it lacks avx2")
    [row] = cpu_code.measure_cpu_code(Bench()).rows
    assert row.is_skipped
    assert "it lacks avx2" in row.note


@pytest.mark.slow
def test_the_dress_hangs_from_both_hands_over_the_bar():
    scene = make_hanging()
    solver, state = scene.build(scene.config)
    for frame in range(scene.frames):
        scene.play(solver, state, frame)
    x = state.get_positions()[0]
    assert x[:, 2].max() > speed_scenes.BAR_HEIGHT + speed_scenes.BAR_RADIUS
    assert x[:, 2].min() > 0.5  # nothing lies on the ground
    assert x[:, 1].min() < -0.2  # one end is where the hands are, the other beyond the bar
    assert x[x[:, 1] > speed_scenes.BAR_RADIUS, 2].min() < speed_scenes.BAR_HEIGHT - 0.2


def _run(mean, tail, milliseconds):
    return {"means": [9.0, mean], "tails": [9.0, tail], "seconds": [1e-3 * milliseconds] * 2}


def test_the_cheapest_setting_that_stretches_little_enough_is_found():
    runs = {4: _run(0.6, 5.0, 1), 6: _run(0.4, 9.0, 2), 8: _run(0.4, 5.0, 3), 9: None}
    settings = [Setting(n, 1) for n in runs]
    trials = equal_strain.find_cheapest(settings, lambda s: runs[s.substeps])
    assert [trial.setting.substeps for trial in trials] == [4, 6, 8]
    [row] = equal_strain.make_rows("dgl-physics", trials, None)
    assert row.value == pytest.approx(3)
    assert "not enough: 6 substeps x 1 iteration: mean strain 0.40 %" in row.note
    _, ratio = equal_strain.make_rows("Newton VBD", trials[-1:], trials[-1])
    assert (ratio.name, ratio.value) == (
        "Newton VBD, frame at equal strain, relative to dgl-physics",
        1,
    )


def test_a_solver_that_stretches_too_much_or_blows_up_is_said():
    bad = {4: _run(0.6, 5.0, 1), 6: _run(None, None, 2)}
    trials = equal_strain.find_cheapest([Setting(n, 2) for n in bad], lambda s: bad[s.substeps])
    [row] = equal_strain.make_rows("Newton XPBD", trials, None)
    assert row.value is None
    assert row.note.startswith("not reached; 6 substeps x 2 iterations: mean strain inf %")


@pytest.mark.slow
def test_this_solver_reaches_the_strain_of_the_comparison():
    settings = equal_strain.SETTINGS[equal_strain.OURS]
    found = hang_here(HungPanel(), 4, SolverConfig(substeps=settings[-1].substeps))
    assert equal_strain.StrainTrial.from_run(settings[-1], found).is_enough
