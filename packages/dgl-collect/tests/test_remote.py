"""Policies behind a websocket."""

import threading
import time
import urllib.request
from types import SimpleNamespace

import msgpack
import numpy as np
import pytest
from websockets.sync.server import serve

from dgl_collect.actors import Expert
from dgl_collect.demonstration import load_demonstration
from dgl_collect.errors import DemonstrationError
from dgl_collect.evaluation.methods import check_method
from dgl_collect.options import EvaluationOptions
from dgl_collect.policy_actor import Learned, PolicyActor
from dgl_collect.remote import (
    Connection,
    PolicyServer,
    RemotePolicy,
    ServedSkill,
    ServedStages,
    make_remote_method,
)
from dgl_collect.remote.client import RemoteSkill, RemoteStage
from dgl_collect.remote.wire import pack, unpack
from dgl_tasks import get_task
from dgl_tasks.errors import PolicyUnavailableError
from dgl_tasks.policy import FromStart

STATE = {"joint_state": np.arange(3, dtype=np.float32)}


@pytest.fixture
def start():
    """Starts servers of a handler, as openpi's are, and stops them; gives their addresses."""
    running = []

    def run(handler):
        server = serve(handler, "127.0.0.1", 0, compression=None)
        threading.Thread(target=server.serve_forever, daemon=True).start()
        running.append(server)
        return f"ws://127.0.0.1:{server.socket.getsockname()[1]}"

    yield run
    for server in running:
        server.shutdown()


def test_messages_come_as_they_went():
    arrays = [np.arange(6).astype(kind).reshape(2, 3) for kind in ("f4", "f8", "u1", "i8", "?")]
    message = {"a": arrays, "b": {"c": "text", "d": None, "e": 1.5}, "n": np.float32(0.1)}
    back = unpack(pack(message))
    for one, other in zip(arrays, back["a"], strict=True):
        assert one.dtype == other.dtype
        np.testing.assert_array_equal(one, other)
    assert back["b"] == message["b"]
    assert back["n"] == message["n"]
    assert isinstance(back["n"], np.float32)


def test_what_is_no_message_is_refused():
    array = {b"__ndarray__": True, b"data": b"1234", b"dtype": "f4", b"shape": (1,)}
    table = [
        b"",
        b"\xc1",
        msgpack.packb({**array, b"dtype": "O"}),
        msgpack.packb({**array, b"shape": (2,)}),
        msgpack.packb({**array, b"dtype": "no such"}),
        msgpack.packb({b"__ndarray__": True}),
    ]
    for data in table:
        with pytest.raises(ValueError, match="must be a message of msgpack"):
            unpack(data)
    with pytest.raises(TypeError, match="numbers, texts and numeric arrays"):
        pack({"a": np.array([object()])})


def test_a_policy_of_openpis_protocol_is_asked_and_acts(start):
    asked = []

    def answer(socket):
        socket.send(pack({"horizon": 8}))
        for message in socket:
            asked.append(unpack(message))
            actions = np.repeat(asked[-1]["observation/state"][None], 8, axis=0)
            socket.send(pack({"actions": actions, "server_timing": {"infer_ms": 0.1}}))

    connection = Connection(start(answer))
    policy = RemotePolicy(connection, "Fold it.")
    policy.reset({**STATE, "garment_point_cloud": np.zeros((5, 3), np.float32)})
    assert connection.metadata == {"horizon": 8}
    for _ in range(2):
        np.testing.assert_array_equal(policy.act(STATE), np.tile(STATE["joint_state"], (8, 1)))
    first, second = asked
    assert first["prompt"] == second["prompt"] == "Fold it."
    assert first["observation/garment_point_cloud"].shape == (5, 3)
    assert "reset" in first
    assert set(second) == {"observation/joint_state", "observation/state", "prompt"}
    connection.close()


def test_a_server_that_fails_is_told_and_asked_again_in_the_next_episode(start, monkeypatch):
    monkeypatch.setattr("dgl_collect.remote.client.ANSWER_SECONDS", 0.3)
    replies = [
        ("Traceback (most recent call last):\nValueError: bad image", "failed: ValueError: bad"),
        (pack({"action": np.zeros((1, 3))}), r"must hold actions of shape .*; got \['action'\]"),
        (pack({"actions": np.zeros(3)}), r"got shape \(3,\)"),
        (pack([1, 2]), "an answer must be a map"),
        (b"\xc1", "must be a message of msgpack"),
        (None, "the connection is lost"),
        ("wait", r"no answer in 0\.3 s"),
        (pack({"actions": np.zeros(2**24)}), "the connection is lost"),  # too long
    ]
    connections = []

    def answer(socket):
        connections.append(1)
        socket.send(pack({}))
        for _ in socket:
            reply = replies[len(seen)][0]
            if reply is None:
                return
            if reply == "wait":
                time.sleep(0.6)
                return
            socket.send(reply)

    seen = []
    policy = RemotePolicy(Connection(start(answer)), "")
    for _, message in replies:
        policy.reset({**STATE, "garment_point_cloud": np.zeros((1, 3))})
        with pytest.raises(PolicyUnavailableError, match=message):
            policy.act(STATE)
        seen.append(1)
    assert len(connections) > 1  # lost ones were made again


class Steps:
    """A policy of a stage that tells what it has been shown."""

    def __init__(self, name):
        self.name, self.constant, self.shown = name, None, []

    def reset(self, observation, *, seed=None):
        self.constant, self.shown = (observation["garment_point_cloud"].sum(), seed), []

    def observe(self, observation):
        self.shown.append(observation["joint_state"][0])

    def act(self, observation):
        self.observe(observation)
        return np.array([[*self.constant, len(self.shown), self.shown[-1]]])


@pytest.fixture
def serve_ours():
    """Starts servers of ours, and stops them."""
    running = []

    def run(make_served):
        server = PolicyServer(make_served, port=0)
        threading.Thread(target=server.run, daemon=True).start()
        running.append(server)
        return server

    yield run
    for server in running:
        server.stop()


@pytest.fixture
def ours(serve_ours):
    """A server of ours with two stages."""
    return serve_ours(
        lambda: ServedStages(
            policies={n: Learned(policy=Steps(n), chunks=k) for k, n in enumerate("ab", start=3)},
            task="FoldTops-v1",
            cloud="segmented",
            is_sent=True,
        )
    )


def test_a_stage_is_shown_the_same_as_a_policy_here(ours):
    far = RemoteStage(Connection(f"ws://127.0.0.1:{ours.port}"), "b")
    near = Steps("b")
    for policy in (far, near):
        policy.reset({"garment_point_cloud": np.ones((4, 3))}, seed=7)
    for k in range(3):
        for j in range(k):
            for policy in (far, near):
                policy.observe({"joint_state": np.array([10.0 * k + j])})
        last = {"joint_state": np.array([k + 0.5])}
        np.testing.assert_array_equal(far.act(last), near.act(last))
    lost = RemoteStage(Connection(f"ws://127.0.0.1:{ours.port}"), "c")
    lost.reset({})
    with pytest.raises(PolicyUnavailableError, match=r"name one of the stages \['a', 'b'\]"):
        lost.act(last)
    with urllib.request.urlopen(f"http://127.0.0.1:{ours.port}/healthz", timeout=5) as answer:
        assert answer.read() == b"OK\n"


class Straight:
    """A skill that leads each hand to an anchor."""

    def plan(self, stage, starts, anchors):
        if stage != "lift":
            raise DemonstrationError(f"no stage {stage!r}")
        hands = {
            side: SimpleNamespace(
                points=np.linspace(start, anchors["end"], 5),
                turns=np.zeros((5, 3)),
                poses=np.ones((5, 2)),
            )
            for side, start in starts.items()
        }
        return SimpleNamespace(hands=hands, spread=0.02)


def test_a_skill_plans_the_same_as_here(serve_ours):
    server = serve_ours(lambda: ServedSkill(skill=Straight(), task="FoldTops-v1"))
    skill = RemoteSkill(connection=Connection(f"ws://127.0.0.1:{server.port}"))
    starts, anchors = {"left": np.zeros(3), "right": np.ones(3)}, {"end": np.arange(3.0)}
    far, near = (each.plan("lift", starts, anchors) for each in (skill, Straight()))
    assert far.spread == near.spread
    for side, way in near.hands.items():
        for name, array in vars(way).items():
            np.testing.assert_array_equal(getattr(far.hands[side], name), array)
    with pytest.raises(PolicyUnavailableError, match="no stage 'drop'"):
        skill.plan("drop", starts, anchors)


def test_a_skill_refuses_what_is_no_way(start):
    way = {name: np.zeros((2, 3)) for name in ("points", "turns", "poses")}
    table = [
        (
            {"actions": np.zeros((1, 3))},
            r"hold the ways of the hands \['left'\]; got \['actions'\]",
        ),
        ({"hands": {"right": way}, "spread": 0.1}, r"hold the ways of the hands \['left'\]"),
        ({"hands": {"left": way}}, "must hold a spread"),
        (
            {"hands": {"left": {**way, "turns": np.zeros(3)}}, "spread": 0.1},
            r"must hold turns of shape \(n, A\); got shape \(3,\)",
        ),
    ]
    replies = iter([reply for reply, _ in table])

    def answer(socket):
        socket.send(pack({}))
        for _ in socket:
            socket.send(pack(next(replies)))

    skill = RemoteSkill(connection=Connection(start(answer)))
    for _, message in table:
        with pytest.raises(PolicyUnavailableError, match=message):
            skill.plan("lift", {"left": np.zeros(3)}, {})


def test_servers_of_ours_act_in_stages_and_others_from_the_start(ours, serve_ours, start):
    made = []
    setup = SimpleNamespace(
        env=SimpleNamespace(task=get_task("FoldTops-v1"), cloud="segmented"),
        demonstration=load_demonstration(get_task("FoldTops-v1")),
        make_runner=lambda actor, **more: made.append((actor, more)) or "runner",
    )
    address = f"ws://127.0.0.1:{ours.port}"
    assert make_remote_method(setup, EvaluationOptions(policy=address)) == "runner"
    ((actor, _),) = made
    assert isinstance(actor, PolicyActor)
    assert {name: each.chunks for name, each in actor.policies.items()} == {"a": 3, "b": 4}
    whole = serve_ours(lambda: ServedSkill(skill=Straight(), task="FoldTops-v1"))
    options = EvaluationOptions(policy=f"ws://127.0.0.1:{whole.port}")
    assert make_remote_method(setup, options) == "runner"
    assert isinstance(made[1][0], Expert)
    assert isinstance(made[1][1]["skill"], RemoteSkill)
    setup.env.task = get_task("FoldDress-v1")
    with pytest.raises(ValueError, match="serves the task FoldTops-v1; got FoldDress-v1"):
        check_method(setup.env.task, EvaluationOptions(policy=address), {})
    with pytest.raises(ValueError, match="serves the task FoldTops-v1; got FoldDress-v1"):
        make_remote_method(setup, EvaluationOptions(policy=address))
    other = start(lambda socket: socket.send(pack({})))
    options = EvaluationOptions(policy=other, control_mode="pd_hand_poses", actions=9)
    method = make_remote_method(setup, options)
    assert isinstance(method, FromStart)
    assert (method.actions, method.control_mode) == (9, "pd_hand_poses")


def test_an_evaluation_without_a_server_does_not_begin(start):
    task = get_task("FoldTops-v1")
    for address in ("ws://127.0.0.1:9", "ws://no such host:1", "ws://127.0.0.1:port"):
        with pytest.raises(PolicyUnavailableError, match="no policy server answers at ws://"):
            check_method(task, EvaluationOptions(policy=address), {})
    address = start(lambda socket: socket.send(pack({})))
    check_method(task, EvaluationOptions(policy=address), {})


def test_options_that_a_method_does_not_take_are_refused(monkeypatch, tmp_path):
    task = get_task("FoldTops-v1")
    with pytest.raises(ValueError, match=r"--checkpoints are of a learned method; got .* expert"):
        check_method(task, EvaluationOptions(policy="expert", checkpoints=tmp_path), {})
    monkeypatch.setattr("torch.cuda.is_available", lambda: False)
    with pytest.raises(ValueError, match="--device cuda needs a GPU"):
        check_method(task, EvaluationOptions(policy="expert", device="cuda"), {})
