"""The verb `eval`, with made-up episodes, and the figures that it computes."""

import dataclasses
import functools
import importlib
import json
import os
import signal
import sys
import threading
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import dgl_collect
from dexgarmentlab.cli import eval as verb
from dexgarmentlab.cli.flags import WorkerFlags, tell_command
from dexgarmentlab.learned_methods import make_evaluation_runner
from dgl_assets import garment_ids, load_garment
from dgl_collect import AttemptRequest, AttemptResult
from dgl_collect.actors import Expert, LiftAndDrop
from dgl_collect.attempt import choose_split, draw_garment
from dgl_collect.attempt_jobs import make_attempt_seed
from dgl_collect.demonstration import load_demonstration
from dgl_collect.evaluation.methods import SCRIPTED, check_method, make_method
from dgl_collect.evaluation.results import Run, summarize, to_json
from dgl_collect.options import EvaluationOptions
from dgl_collect.setup import Setup
from dgl_physics import MeshError
from dgl_tasks import get_task
from dgl_tasks.errors import UnknownTaskError, UnreachableError
from dgl_tasks.evaluation import EpisodeResult
from dgl_tasks.policy import FromStart, Method, Nothing
from dgl_tasks.success import Criterion, Verdict

COLLECT_TESTS = Path(__file__).parents[1] / "packages/dgl-collect/tests"


@pytest.fixture
def fake(monkeypatch):
    """Make the verb use made-up episodes, made in this process."""
    monkeypatch.syspath_prepend(str(COLLECT_TESTS))
    fakes = importlib.import_module("dgl_collect_fakes")
    config = dgl_collect.CollectConfig

    def use(*, has_processes=False, **options):
        if not has_processes:
            fakes.work_here(monkeypatch)
        made_up = {"attempt_factory": fakes.FACTORY, "options": options}
        monkeypatch.setattr(
            "dgl_collect.CollectConfig", lambda **content: config(**{**content, **made_up})
        )

    return use


def options(out, **changes):
    names = {item.name for item in dataclasses.fields(EvaluationOptions)}
    ours = {"policy": "nothing"} | {k: v for k, v in changes.items() if k in names}
    content = {"task": "FoldTops-v1", "episodes": 3, "seeds": "0,1", "out": out}
    content |= {k: v for k, v in changes.items() if k not in names}
    return verb.EvalOptions(run=EvaluationOptions(**ours), **content)


def count_even(seed, episodes, *, of=2):
    """Made-up episodes succeed for even seeds, and at the first try for those that four divides."""
    seeds = [make_attempt_seed(verb.SEED_OFFSET + seed, k) for k in range(episodes)]
    return sum(s % of == 0 for s in seeds)


def test_results_hold_every_seed_and_every_episode(fake, tmp_path, capsys):
    fake()
    assert verb.run(options(tmp_path / "out", episodes=6)) == 0
    out = capsys.readouterr().out
    results = json.loads((tmp_path / "out/results.json").read_text())
    succeeded = [count_even(seed, 6) for seed in (0, 1)]
    first = [count_even(seed, 6, of=4) for seed in (0, 1)]
    assert 0 < sum(first) < sum(succeeded) < 12
    assert f"nothing: {sum(first)} of 12 episodes succeeded at the first try, " in out
    assert f"try, {sum(succeeded)} with retries, " in out
    assert f"report: {tmp_path / 'out/index.html'}" in out
    page = (tmp_path / "out/index.html").read_text(encoding="utf-8")
    assert f"{sum(first)} of 12" in page
    assert f"{sum(succeeded)} of 12" in page
    assert (tmp_path / "out/pictures.jpg").is_file()
    assert [item["succeeded"] for item in results["by_seed"].values()] == succeeded
    assert [item["first_try"] for item in results["by_seed"].values()] == first
    assert results["success"]["mean"] == pytest.approx(sum(succeeded) / 12)
    assert [(r["seed"], r["episode"]) for r in results["runs"]] == [
        (seed, episode) for seed in (0, 1) for episode in range(6)
    ]
    assert sum(record["first_try"] for record in results["runs"]) == sum(first)
    # what was believed is kept, and counts for nothing
    assert all(record["beliefs"] == {"value": 0.7} for record in results["runs"])
    for record in results["runs"]:
        for kind in ("video", "picture"):
            assert (tmp_path / "out" / record["files"][kind]).is_file()
    assert results["status"] == "complete"
    assert results["command"].startswith("dgl eval FoldTops-v1 --policy nothing --out")
    assert results["versions"]["python"]
    collected = {make_attempt_seed(seed, k) for seed in range(3) for k in range(100)}
    assert not collected & {record["episode_seed"] for record in results["runs"]}


def interrupt_after_an_episode(out):
    """Press Ctrl-C for the process once an episode is recorded, however slow the machine is."""
    while not any(file.stat().st_size for file in out.rglob("attempts.jsonl")):
        time.sleep(0.05)
    os.kill(os.getpid(), signal.SIGINT)


@pytest.mark.slow
@pytest.mark.usefixtures("heeds_interrupts")
def test_an_interrupted_evaluation_goes_on(fake, tmp_path, capsys):
    fake(has_processes=True, seconds=0.3)
    asked = options(tmp_path / "my out", episodes=60, seeds="3,4")
    threading.Thread(target=interrupt_after_an_episode, args=(asked.out,), daemon=True).start()
    assert verb.run(asked) == 130
    said = capsys.readouterr().err.strip().splitlines()[-1]
    assert "of 120 episodes; continue with: dgl eval FoldTops-v1 --policy nothing" in said
    assert said.endswith("my out' --episodes 60 --seeds 3,4 --resume")
    results = json.loads((tmp_path / "my out/results.json").read_text())
    assert results["status"] == "interrupted"
    assert "This run was interrupted" in (tmp_path / "my out/index.html").read_text()
    done = results["success"]["episodes"]
    assert 0 < done < 60
    left = options(tmp_path / "my out", episodes=done + 1, seeds="3", resume=True, json=True)
    assert verb.run(left) == 0
    results = json.loads(capsys.readouterr().out)
    assert results["status"] == "complete"
    assert results["success"]["episodes"] == done + 1


def test_refusals_come_before_any_work(fake, tmp_path):
    fake()
    for changes, kind, message in (
        ({"task": "FoldTop-v1"}, UnknownTaskError, "did you mean 'FoldTops-v1'"),
        ({"policy": "magic"}, ValueError, "must be one of nothing, lift-drop, expert.*'magic'"),
        ({"policy": "no_such.module:make"}, ValueError, "there is no module no_such.module here"),
        ({"seeds": "0,0"}, ValueError, "different numbers from 0 to 999,999.*'0,0'"),
        ({"seeds": "a"}, ValueError, "separated by commas; got 'a'"),
        ({"seeds": "-1"}, ValueError, "got '-1'"),
        ({"friction": -0.5}, ValueError, "friction should be greater than or equal to 0; got -0.5"),
        ({"actions": 0}, ValueError, "actions should be greater than or equal to 1; got 0"),
        ({"episodes": 0}, ValueError, "episodes should be greater than or equal to 1; got 0"),
    ):
        with pytest.raises(kind, match=message):
            verb.run(options(tmp_path / "out", **changes))
    assert not (tmp_path / "out").exists()


def test_the_folder_of_a_collection_is_refused(fake, tmp_path):
    fake()
    (tmp_path / "run.json").write_text("{}")
    with pytest.raises(ValueError, match=r"the folder of an evaluation; .* has a collection"):
        verb.run(options(tmp_path, resume=True))
    assert [path.name for path in tmp_path.iterdir()] == ["run.json"]


def test_the_command_asks_for_the_same(tmp_path):
    asked = options(
        tmp_path / "out",
        friction=0.0,
        garments="test",
        workers=WorkerFlags(workers=2, engine="ray", address="10.0.0.1:6379"),
    )
    assert tell_command("eval", asked) == (
        "dgl eval FoldTops-v1 --policy nothing --garments test --friction 0.0 "
        f"--out {tmp_path}/out --episodes 3 --seeds 0,1 --workers 2 "
        "--engine ray --address 10.0.0.1:6379"
    )


def make_run(seed, successes, split="train"):
    return Run(
        seed=seed,
        folder=Path(f"seed-{seed}"),
        results=[
            AttemptResult(
                index=k,
                seed=k,
                success=success,
                first_try=success and k % 2 == 0,
                value=0.9 if success else 0.3,
                reason=None if success else "slipped",
                randomisation={"split": split if k % 2 else "test"},
                seconds=10.0 + k,
            )
            for k, success in enumerate(successes)
        ],
    )


def test_figures_by_hand():
    """3 of 4 and 1 of 4: mean 0.5, standard deviation of 0.75 and 0.25 with n - 1 is 0.3536."""
    results = summarize([make_run(0, [True] * 3 + [False]), make_run(1, [True] + [False] * 3)])
    assert results.mean == 0.5
    assert results.std == pytest.approx(0.35355, abs=1e-5)
    assert (results.total.succeeded, results.total.episodes) == (4, 8)
    assert results.total.first_try == 3  # all but the second one of the first seed
    assert results.total.interval == pytest.approx((0.2152, 0.7848), abs=1e-4)
    assert {k: (c.succeeded, c.episodes) for k, c in results.by_split.items()} == {
        "test": (3, 4),
        "train": (1, 4),
    }
    assert results.reasons == {"slipped": 4}
    assert (results.value_least, results.value_largest) == (0.3, 0.9)
    assert results.value_median == pytest.approx(0.6)
    assert results.seconds_median == 11.5


def test_placement_errors_have_a_median_where_they_are_measured():
    run = make_run(0, [True] * 4)
    assert summarize([run]).placement_error is None
    placed = [
        dataclasses.replace(result, measurements={"placement_error_m": 0.01 * k})
        for k, result in enumerate(run.results[1:])
    ]
    run = dataclasses.replace(run, results=[run.results[0], *placed])
    results = summarize([run])
    assert (results.placement_error.count, results.placement_error.median) == (3, 0.01)
    content = to_json(results, [run], asked={}, status="complete", versions={})
    assert content["placement_error_m"] == {"count": 3, "median": 0.01, "interval": None}
    assert [record["placement_error_m"] for record in content["runs"]] == [None, 0.0, 0.01, 0.02]


def test_one_seed_has_no_spread_and_no_episode_no_rate():
    assert summarize([make_run(0, [True])]).std is None
    empty = summarize([make_run(0, [])])
    assert empty.mean is None
    assert empty.total.interval == (0.0, 1.0)
    assert empty.reasons == {}


def test_garments_come_from_the_split_by_turns():
    assert [choose_split("both", k) for k in range(4)] == ["train", "test", "train", "test"]
    assert [choose_split("test", k) for k in range(2)] == ["test", "test"]
    task = get_task("FoldTrousers-v1")
    for split in ("train", "test"):
        ids = set(garment_ids("Trousers", split))
        drawn = [draw_garment(task, split, seed) for seed in range(20)]
        assert set(drawn) <= ids
        assert len(set(drawn)) > 15
        assert drawn == [draw_garment(task, split, seed) for seed in range(20)]
        right = dataclasses.replace(task, category="Glove", measures={"hand": "right"})
        hands = {load_garment(draw_garment(right, split, k)).parameters["hand"] for k in range(3)}
        assert hands == {"right"}


class StandingStill:
    """A policy of one's own."""

    def reset(self, observation):
        self.target = observation["joint_state"]

    def act(self, observation):
        return self.target[None]


def give_nothing(env):
    return object()


def test_a_policy_of_ones_own_is_found_by_its_name(monkeypatch):
    monkeypatch.syspath_prepend(str(Path(__file__).parent))
    setup = SimpleNamespace(env=SimpleNamespace(task=None))

    def make(name):
        return make_method(setup, EvaluationOptions(policy=name, actions=7), {})

    name = "test_cli_eval:make_standing_still"
    made = make(name)
    assert isinstance(made, FromStart)
    assert made.actions == 7
    with pytest.raises(ValueError, match="with reset and act, or with run; got object"):
        make("test_cli_eval:give_nothing")
    with pytest.raises(ValueError, match="must name something callable; got None"):
        make("test_cli_eval:absent")


def make_method_for(name, task_id="FoldTops-v1", **options):
    options = EvaluationOptions(policy=name, **options)
    setup = Setup(
        options=options,
        env=SimpleNamespace(task=get_task(task_id)),
        demonstration=load_demonstration(task_id),
        matcher="exact",
        find_matcher=lambda env: ("matcher of", env),
        demo_cloud=np.zeros((3, 3), np.float32),
        motion=None,
    )
    return make_method(setup, options, {}), setup


def test_methods_without_learning_are_found_by_their_names():
    made = {name: make_method_for(name)[0] for name in SCRIPTED}
    assert all(isinstance(method, Method) for method in made.values())
    assert isinstance(made["nothing"], Nothing)
    assert isinstance(made["expert"].actor, Expert)
    assert isinstance(made["lift-drop"].actor, LiftAndDrop)
    for name in SCRIPTED:
        check_method(get_task("FoldTops-v1"), EvaluationOptions(policy=name), {})


def test_the_expert_does_all_stages_as_often_as_the_demonstration_says():
    expert, setup = make_method_for("expert", "FoldTrousers-v1")
    assert expert.demonstration is setup.demonstration
    assert expert.rounds is None
    assert expert.rule is setup.env.task.success
    assert expert.get_matcher() == ("matcher of", setup.env)  # of the garment as it lies
    assert make_method_for("expert", rounds=2)[0].rounds == 2


def test_what_is_lifted_and_dropped_is_so_once():
    method, setup = make_method_for("lift-drop", "FlingTrousers-v1", rounds=5)
    assert method.demonstration.stages == setup.demonstration.stages[:1]
    assert (method.rounds, method.tries) == (1, 1)


def test_a_module_beside_the_command_is_found(fake, tmp_path, monkeypatch):
    fake()
    (tmp_path / "beside_me.py").write_text("def make(env):\n    return None\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.path", [path for path in sys.path if path])
    check = functools.partial(verb.run, options(tmp_path / "out", policy="beside_me:make"))
    monkeypatch.setattr(verb, "_configure", lambda *_: (_ for _ in ()).throw(KeyboardInterrupt))
    with pytest.raises(KeyboardInterrupt):  # it got as far as the work
        check()
    assert str(tmp_path) in sys.path


def make_standing_still(env):
    return StandingStill()


def test_unknown_garments_are_refused():
    with pytest.raises(ValueError, match=r"garments should be 'both'.*; got 'mine'"):
        EvaluationOptions(policy="nothing", garments="mine")


class FakeEnv:
    """Has what an episode is described by."""

    def __init__(self):
        self.task = get_task("FoldTops-v1")
        self.draws = {"x": 0.1, "garment": "tops/1"}
        self.is_closed = False

    def film(self):
        return np.full((4, 4, 3), 7, np.uint8)

    def get_particles(self):
        return np.zeros((1, 3))

    def measure_pulls(self):
        return {}

    def get_frames(self):
        return {}

    def close(self):
        self.is_closed = True


@pytest.fixture
def fake_setup(monkeypatch):
    setup = SimpleNamespace(env=FakeEnv(), motion="motion", declared=None)

    def make(task, options):
        setup.declared, setup.options = task, options
        return setup

    monkeypatch.setattr("dgl_collect.evaluation.methods.make_setup", make)
    return setup


def run_fake(monkeypatch, folder, end, **options):
    """Run one episode that ends as `end` does, and give the result and what was asked for."""
    asked = {}

    def run_episode(env, motion, policy, *, seed, garment, film, listener):
        asked.update(policy=policy, seed=seed, garment=garment)
        film(np.zeros((4, 4, 3), np.uint8))
        return end()

    monkeypatch.setattr("dgl_collect.attempt.run_episode", run_episode)
    runner = make_evaluation_runner("FoldTops-v1", EvaluationOptions(policy="nothing", **options))
    result = runner.run(AttemptRequest(index=1, seed=5, episode_id="e"), folder)
    runner.close()
    return result, asked


def finish(value=0.9, mishaps=()):
    share = Criterion(name="share", value=value, comparison=">=", threshold=0.8)
    verdict = Verdict(criteria=(share,))
    return EpisodeResult(
        garment="tops/1",
        verdict=verdict,
        first_try=verdict,
        picture=np.zeros((4, 4, 3), np.uint8),
        commands=np.zeros((321, 60), np.float32),
        measurements={"max_strain_mean": 0.01},
        beliefs={"value": 0.2},
        draws={"x": 0.1},
        mishaps=mishaps,
    )


def test_an_episode_is_described_with_film_picture_and_split(monkeypatch, fake_setup, tmp_path):
    result, asked = run_fake(monkeypatch, tmp_path, finish, friction=0.0)
    assert (result.success, result.value, result.reason) == (True, 0.9, None)
    assert result.measurements == {"max_strain_mean": 0.01, "steps": 321.0}
    assert result.randomisation == {
        "x": 0.1,
        "garment": "tops/1",
        "split": "test",
    }  # the second episode's garment
    assert asked["garment"] in garment_ids("Tops_LongSleeve", "test")
    assert result.beliefs == {"value": 0.2}  # which count for nothing
    assert result.first_try
    declared = fake_setup.declared
    assert declared.material.friction == declared.material.adhesion == 0.0
    assert get_task("FoldTops-v1").material.friction > 0
    for name in result.files.values():
        assert (tmp_path / name).is_file()
    assert fake_setup.env.is_closed


def test_a_failure_has_the_first_thing_that_went_wrong(monkeypatch, fake_setup, tmp_path):
    mishaps = (("slipped", "left_sleeve, left hand"), ("missed grasp", "later"))
    result, _ = run_fake(monkeypatch, tmp_path, lambda: finish(0.5, mishaps))
    assert (result.success, result.reason) == (False, "slipped")
    assert result.detail == "left_sleeve, left hand; share: 0.500, needed >= 0.8"


def test_what_cannot_be_reached_is_a_failure(monkeypatch, fake_setup, tmp_path):
    def fail():
        raise UnreachableError("the left arm cannot reach that")

    picture = np.full((4, 4, 3), 7, np.uint8)
    monkeypatch.setattr("dgl_tasks.env.GarmentEnv.film", lambda env: picture)
    result, _ = run_fake(monkeypatch, tmp_path, fail)
    assert (result.success, result.value, result.reason) == (False, None, "unreachable")
    assert result.detail == "the left arm cannot reach that"
    assert (tmp_path / "e.png").is_file()


def test_a_garment_that_cannot_be_simulated_ends_the_episode_with_its_error(
    monkeypatch, fake_setup, tmp_path
):
    def fail():
        raise MeshError("a wall folds over itself")

    with pytest.raises(MeshError, match="a wall folds over itself"):
        run_fake(monkeypatch, tmp_path, fail)


@pytest.mark.slow
@pytest.mark.timeout(1800)
@pytest.mark.render
def test_an_episode_of_doing_nothing_leaves_film_picture_and_value(tmp_path, coarse_garments):
    options = EvaluationOptions(policy="nothing", garments="test", friction=0.0)
    runner = make_evaluation_runner("FoldTops-v1", options)
    try:
        result = runner.run(AttemptRequest(index=0, seed=11, episode_id="e"), tmp_path)
        assert runner._setup.env.task.material.friction == 0.0
    finally:
        runner.close()
    assert not result.success
    assert result.reason == "below the threshold"
    assert 0.3 < result.value < 0.85
    assert result.garment_id in garment_ids("Tops_LongSleeve", "test")
    assert result.measurements["steps"] > 50
    for name in result.files.values():
        assert (tmp_path / name).stat().st_size > 1000
