"""Readers return the content of a file or raise their own error, for mutated and random files."""

# ruff: noqa: PT017 - an error is one of the two things that may come
import copy
import importlib
import json
from importlib import resources
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from dgl_collect import CorruptEpisodeError, Episode, OutputFolderError, read_episode, write_episode
from dgl_collect.demonstration import parse_demonstration
from dgl_collect.errors import DemonstrationError
from dgl_collect.previews import read_previews
from dgl_collect.results import AttemptResult
from dgl_collect.run_folder import RunRecord, read_run
from dgl_collect.steps import Demonstration

quick = settings(
    max_examples=20,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
thorough = settings(quick, max_examples=200)

STRANGE = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(),
    st.just(10**400),
    st.floats(),
    st.text(max_size=6),
    st.sampled_from(["", "../../x", "/etc/passwd", "1e999", "\0", "9" * 400]),
    st.lists(st.integers(), max_size=3),
    st.dictionaries(st.text(max_size=3), st.integers(), max_size=2),
)
LINE = {
    "index": 3,
    "seed": 7,
    "success": False,
    "first_try": False,
    "value": 0.5,
    "reason": "on the ground",
    "detail": "x",
    "criteria": [{"name": "x", "value": 0.5, "comparison": ">=", "threshold": 0.8}],
    "garment_id": "tops/1",
    "seconds": 1.5,
    "frames": 2,
    "files": {"picture": "failed/x.png"},
    "randomisation": {"x": 0.1},
    "measurements": {"steps": 4.0},
}
RUN = {
    "run_format": 1,
    "task": "FoldTops-v1",
    "seed": 0,
    "attempt_factory": "m:f",
    "options": {},
    "versions": {"a": "1"},
    "commands": ["dgl collect"],
    "machines": [{"host": "a", "cpu": "b", "cpu_code": "vector"}],
}


def find_places(tree, path=()):
    """List the paths of everything in a tree of JSON, itself left out."""
    items = tree.items() if isinstance(tree, dict) else enumerate(tree)
    found = []
    for key, value in items:
        found.append((*path, key))
        if isinstance(value, (dict, list)):
            found += find_places(value, (*path, key))
    return found


def mutate(draw, tree):
    """Change, remove or add a few things."""
    tree = copy.deepcopy(tree)
    for _ in range(draw(st.integers(1, 3))):
        places = find_places(tree)
        if not places:
            break
        *path, last = draw(st.sampled_from(places))
        node = tree
        for key in path:
            node = node[key]
        match draw(st.sampled_from(["change", "change", "remove", "add"])):
            case "change":
                node[last] = draw(STRANGE)
            case "remove":
                del node[last]
            case "add" if isinstance(node, dict):
                node[draw(st.text(max_size=4))] = draw(STRANGE)
            case "add":
                node.append(draw(STRANGE))
    return tree


def check_line(text):
    try:
        result = AttemptResult.from_line(text)
    except ValueError as err:
        assert "\n" not in str(err)
        assert len(str(err)) < 400
        return
    assert type(result.success) is bool
    assert result.index >= 0
    assert AttemptResult.from_line(result.to_line()) == result


def test_a_strange_name_does_not_break_the_line_of_its_error():
    with pytest.raises(ValueError, match=r"result; '\\n': unexpected keyword argument; got None$"):
        AttemptResult.from_line(json.dumps(LINE | {"\n": None}))


@quick
@given(st.data())
def test_lines_of_attempts(data):
    check_line(json.dumps(mutate(data.draw, LINE)))


@quick
@given(st.one_of(st.text(), st.binary().map(lambda b: b.decode("latin-1"))))
def test_lines_of_any_text(text):
    check_line(text)


@quick
@given(st.data())
def test_run_files(tmp_path, data):
    whole = data.draw(st.booleans())
    content = json.dumps(mutate(data.draw, RUN)).encode() if whole else data.draw(st.binary())
    (tmp_path / "run.json").write_bytes(content)
    try:
        assert isinstance(read_run(tmp_path), RunRecord)
    except OutputFolderError as err:
        assert str(tmp_path / "run.json") in str(err)
        assert "\n" not in str(err)


@pytest.fixture(scope="module")
def demonstrations():
    folder = resources.files("dgl_collect") / "demonstrations"
    return [
        json.loads(file.read_text(encoding="utf-8"))
        for file in sorted(folder.iterdir(), key=lambda file: file.name)
        if file.name.endswith(".json")
    ]


@quick
@given(st.data())
def test_demonstrations(demonstrations, data):
    content = mutate(data.draw, data.draw(st.sampled_from(demonstrations)))
    try:
        assert isinstance(parse_demonstration(content, source="mine.json"), Demonstration)
    except DemonstrationError as err:
        assert str(err).startswith("mine.json: ")
        assert "\n" not in str(err)


def test_a_strange_value_does_not_break_the_line_of_its_error(demonstrations):
    whole = next(d for d in demonstrations if d["task"] == "FoldTops-v1")
    for number, place, value in ((2, "right", "\n"), (0, "come_from", "\n"), (2, "\n", 0)):
        content = copy.deepcopy(whole)
        content["stages"][0]["steps"][number][place] = value
        with pytest.raises(DemonstrationError, match=r"^mine.json: stages\[0\].*'\\n'"):
            parse_demonstration(content, source="mine.json")


def test_a_point_is_three_numbers(demonstrations):
    content = copy.deepcopy(next(d for d in demonstrations if d["task"] == "FoldTops-v1"))
    name = next(iter(content["points"]))
    for value in (None, 1, "abc", [1, 2], [0, 0, "0"], [0, 0, True], [0, 0, None], [0, 0, {}],
                  [0, 0, []], [0, 0, 10**400], [0, 0, -3.01], [0, 0, float("nan")]):  # fmt: skip
        content["points"][name] = value
        with pytest.raises(DemonstrationError, match=r"^mine.json: points.*three numbers.*; got"):
            parse_demonstration(content, source="mine.json")
    content["points"][name] = [3, -3.0, 0]
    assert parse_demonstration(content, source="mine.json").points[name].tolist() == [3, -3, 0]


@pytest.fixture(scope="module")
def episode_bytes(tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(Path(__file__).parent))
        fakes = importlib.import_module("dgl_collect_fakes")
    stage = fakes.make_stage(0, image=np.zeros((2, 480, 640, 3), np.uint8))
    path = tmp_path_factory.mktemp("episode") / "episode.h5"
    write_episode(path, fakes.make_episode(0, stages=(stage,)))
    return path.read_bytes()


def check_episode(tmp_path, episode_bytes, data):
    content = bytearray(episode_bytes)
    # The first bytes are metadata: there lie the shapes and the links.
    area = data.draw(st.sampled_from([len(content), 20_000, 2000, 200]))
    for _ in range(data.draw(st.integers(1, 4))):
        content[data.draw(st.integers(0, area - 1))] = data.draw(st.integers(0, 255))
    if data.draw(st.integers(0, 4)) == 0:
        del content[data.draw(st.integers(0, len(content))) :]
    path = tmp_path / "episode.h5"
    path.write_bytes(content)
    for read in (read_episode, read_previews):
        try:
            found = read(path)
        except CorruptEpisodeError as err:
            assert err.path == path
            continue
        if read is read_episode:
            assert isinstance(found, Episode)


@quick
@given(st.data())
def test_episodes(tmp_path, episode_bytes, data):
    check_episode(tmp_path, episode_bytes, data)


@pytest.mark.slow
@thorough
@given(st.data())
def test_many_episodes(tmp_path, episode_bytes, data):
    check_episode(tmp_path, episode_bytes, data)


@pytest.mark.slow
@thorough
@given(st.data())
def test_many_demonstrations_and_lines(demonstrations, data):
    check_line(json.dumps(mutate(data.draw, LINE)))
    content = mutate(data.draw, data.draw(st.sampled_from(demonstrations)))
    try:
        parse_demonstration(content, source="mine.json")
    except DemonstrationError as err:
        assert "\n" not in str(err)
