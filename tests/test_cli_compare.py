"""The verb `compare`, on made-up evaluations."""

import json

import pytest

from dexgarmentlab.cli import main


def write(folder, successes, *, policy="halo", task="FoldTops-v1", friction=1.0, garment="T/{}"):
    """Write an evaluation of seed 3; None is an episode that has not been run."""
    runs = [
        {
            "seed": 3,
            "episode": k,
            "episode_seed": 100 + k,
            "garment": garment.format(k),
            "first_try": success,
            "success": success,
            "value": 0.9 if success else 0.25,
        }
        for k, success in enumerate(successes)
        if success is not None
    ]
    content = {"format": 1, "task": task, "policy": policy, "friction": friction, "runs": runs}
    folder.mkdir()
    (folder / "results.json").write_text(json.dumps(content))
    return str(folder)


def test_figures_by_hand(tmp_path, capsys):
    """Of nine unequal episodes eight are of one method: p is 2 (1 + 9) / 2^9."""
    first = write(tmp_path / "a", [True] * 8 + [False, True, False], policy="halo")
    second = write(tmp_path / "b", [False] * 8 + [True, True, False], policy="dp3")
    assert main(["compare", first, second, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["task"] == "FoldTops-v1"
    assert [m["succeeded"] for m in found["methods"]] == [9, 2]
    assert [m["value_median"] for m in found["methods"]] == [0.9, 0.25]
    assert found["methods"][0]["interval"] == pytest.approx([0.5230, 0.9486], abs=1e-4)
    (pair,) = found["pairs"]
    assert pair["first_alone"] == [[3, k] for k in range(8)]
    assert pair["second_alone"] == [[3, 8]]
    assert (pair["both"], pair["neither"]) == ([[3, 9]], [[3, 10]])
    assert pair["p"] == pytest.approx(20 / 512)

    assert main(["compare", first, second]) == 0
    shown = capsys.readouterr().out
    assert "FoldTops-v1, 11 episodes that all have run" in shown
    assert "0.039" in shown


def place(folder, errors):
    """Give the episodes of an evaluation their placement errors [m]."""
    path = folder / "results.json"
    content = json.loads(path.read_text())
    for run, error in zip(content["runs"], errors, strict=True):
        run["placement_error_m"] = error
    path.write_text(json.dumps(content))


def test_placement_errors_are_compared_episode_by_episode(tmp_path, capsys):
    """Of seven differences all are negative: p is 2 / 2^7; the eighth episode has no pair."""
    count = 8
    first = write(tmp_path / "a", [True] * count)
    second = write(tmp_path / "b", [True] * count, policy="dp3")
    ours = [0.01 * (k + 1) for k in range(count)]
    place(tmp_path / "a", ours)
    place(tmp_path / "b", [error + 0.02 + 0.001 * k for k, error in enumerate(ours[:-1])] + [None])
    assert main(["compare", first, second, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    placed = [method["placement_error_m"] for method in found["methods"]]
    assert [item["count"] for item in placed] == [8, 7]
    assert placed[0]["median"] == pytest.approx(0.045)
    assert placed[0]["interval"] == pytest.approx([0.01, 0.08])  # 1 - 2 / 2^8 of certainty
    (pair,) = found["pairs"]
    difference = pair["placement_error_m"]
    assert difference["count"] == 7
    assert difference["median"] == pytest.approx(-0.023)
    assert difference["p_value"] == pytest.approx(2 / 2**7)
    assert pair["p"] == 1.0

    assert main(["compare", first, second]) == 0
    shown = capsys.readouterr().out
    assert "4.5 cm (1.0 to 8.0)" in shown
    assert "-2.3 cm (-2.6 to -2.0)" in shown
    assert "0.016" in shown


def test_placement_errors_that_are_missing_or_equal(tmp_path, capsys):
    first, second = (write(tmp_path / name, [True, False]) for name in "ab")
    assert main(["compare", first, second, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert [method["placement_error_m"] for method in found["methods"]] == [None, None]
    assert found["pairs"][0]["placement_error_m"] is None
    for name in "ab":
        place(tmp_path / name, [0.1, 0.2])
    assert main(["compare", first, second, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["methods"][0]["placement_error_m"]["interval"] is None  # of two episodes
    assert found["pairs"][0]["placement_error_m"]["p_value"] == 1.0


def test_equal_methods_are_not_told_apart(tmp_path, capsys):
    folders = [write(tmp_path / name, [True, False]) for name in "abc"]
    assert main(["compare", *folders, "--json"]) == 0
    pairs = json.loads(capsys.readouterr().out)["pairs"]
    assert [pair["p"] for pair in pairs] == [1.0] * 3
    assert [(p["first"][-1], p["second"][-1]) for p in pairs] == [
        ("a", "b"),
        ("a", "c"),
        ("b", "c"),
    ]


def test_only_episodes_that_all_have_count(tmp_path, capsys):
    first = write(tmp_path / "a", [True, False, True, True])
    second = write(tmp_path / "b", [None, True, False])
    assert main(["compare", first, second, "--json"]) == 0
    told = capsys.readouterr()
    found = json.loads(told.out)
    assert found["episodes"] == [[3, 1], [3, 2]]
    assert [m["succeeded"] for m in found["methods"]] == [1, 1]
    assert f"{first} has 2 more episodes" in told.err
    assert f"{second} has" not in told.err


def test_what_did_not_begin_alike_is_refused(tmp_path, capsys):
    first = write(tmp_path / "a", [True, False])
    for name, changes, message in (
        ("task", {"task": "FoldDress-v1"}, "task is FoldTops-v1 and FoldDress-v1"),
        ("friction", {"friction": 0.0}, "friction is 1.0 and 0.0"),
        ("garment", {"garment": "T/0"}, "episode 1 of seed 3 began with T/1 (seed 101)"),
    ):
        other = write(tmp_path / name, [True, False], **changes)
        assert main(["compare", first, other]) == 1
        assert message in capsys.readouterr().err
    other = write(tmp_path / "none", [None, None, True])
    assert main(["compare", first, other]) == 1
    assert "there is no episode that all of" in capsys.readouterr().err
    assert main(["compare", first]) == 1
    assert "at least two evaluations are compared; got 1" in capsys.readouterr().err


def test_damaged_and_foreign_results_are_refused_by_name(tmp_path, capsys):
    first = write(tmp_path / "a", [True])
    other = tmp_path / "b"
    assert main(["compare", first, str(other)]) == 1
    assert f"{other} holds no evaluation" in capsys.readouterr().err
    other.mkdir()
    whole = (tmp_path / "a/results.json").read_text()
    for text in (
        whole[:-20],
        "[]",
        whole.replace('"format": 1', '"format": 2'),
        whole.replace("success", "won"),
        whole.replace('"success": true', '"success": "false"'),
        whole.replace('"episode": 0', '"episode": 0.9'),
        whole.replace('"value": 0.9', '"value": NaN'),
        whole.replace("}]", "}, " + whole[whole.index("[") + 1 : whole.index("]")] + "]"),
    ):
        (other / "results.json").write_text(text)
        assert main(["compare", first, str(other)]) == 1
        told = capsys.readouterr().err
        assert told.startswith(f"dgl: {other}/results.json: ")
        assert "the file is damaged or not of dgl eval" in told


def test_an_episode_that_an_exception_has_ended_counts_as_failed(tmp_path, capsys):
    first = write(tmp_path / "a", [True, True])
    second = write(tmp_path / "b", [True, False])
    path = tmp_path / "b/results.json"
    content = json.loads(path.read_text())
    content["runs"][1] |= {"garment": None, "value": None}
    path.write_text(json.dumps(content))
    assert main(["compare", first, second, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert [m["succeeded"] for m in found["methods"]] == [2, 1]
