"""Client of a policy server."""

from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any

import numpy as np
from websockets.exceptions import WebSocketException
from websockets.sync.client import connect
from websockets.sync.connection import Connection as Socket

from dgl_assets.robots import Side
from dgl_collect.actors import Expert
from dgl_collect.options import EvaluationOptions
from dgl_collect.policy_actor import Learned, PolicyActor
from dgl_collect.remote.served import SKILL, STAGES
from dgl_collect.remote.wire import pack, unpack
from dgl_collect.setup import Setup
from dgl_collect.skill import follow_recordings
from dgl_tasks.declaration import Task
from dgl_tasks.errors import PolicyUnavailableError
from dgl_tasks.policy import Arrays, FromStart, Method

__all__ = [
    "Connection",
    "RemotePolicy",
    "RemoteSkill",
    "RemoteStage",
    "check_served",
    "is_address",
    "make_remote_method",
]

OPEN_SECONDS, ANSWER_SECONDS = 5.0, 60.0
LARGEST_ANSWER = 2**24
"""Largest message of a server [bytes]."""
WAY_NAMES = ("points", "turns", "poses")


def is_address(name: str) -> bool:
    """Tell if the name of a method is the address of a policy server."""
    return name.startswith(("ws://", "wss://"))


class Connection:
    """A connection to a policy server, which is made again at the beginning of an episode."""

    def __init__(self, address: str) -> None:
        """Take the address, such as "ws://127.0.0.1:8000"."""
        self.address = address
        self._opened = ExitStack()
        self._socket: Socket | None = None
        self.metadata: Mapping[str, Any] = {}
        """Map that the server sends about itself."""

    def open(self) -> None:
        """Connect, unless there is a connection.

        Raises:
            PolicyUnavailableError: If no policy server answers.
        """
        if self._socket is not None:
            return
        try:
            self._socket = self._opened.enter_context(
                connect(
                    self.address,
                    compression=None,
                    max_size=LARGEST_ANSWER,
                    open_timeout=OPEN_SECONDS,
                )
            )
            self.metadata = self._receive(OPEN_SECONDS)
        except (OSError, ValueError, WebSocketException) as err:
            self.close()
            raise PolicyUnavailableError(
                f"no policy server answers at {self.address}, such as dgl serve POLICY TASK --port "
                f"8000 at ws://127.0.0.1:8000: {err}"
            ) from err

    def close(self) -> None:
        """Give up the connection."""
        self._socket = None
        self._opened.close()

    def ask(self, message: Mapping[str, object]) -> dict[str, Any]:
        """Send a message; return the answer.

        Raises:
            PolicyUnavailableError: If the connection is lost, the answer takes more than a minute,
                or it is an error or no map.
        """
        self.open()
        assert self._socket is not None
        try:
            self._socket.send(pack(message))
        except (OSError, WebSocketException) as err:
            self.close()
            raise PolicyUnavailableError(f"{self.address}: the connection is lost: {err}") from err
        return self._receive(ANSWER_SECONDS)

    def ask_actions(self, message: Mapping[str, object]) -> np.ndarray:
        """Send an observation; return the actions, shape (n, A).

        Raises:
            PolicyUnavailableError: As `ask` does, or if the answer holds no such actions.
        """
        return self.take(self.ask(message), "actions")

    def take(self, answer: Mapping[str, Any], name: str) -> np.ndarray:
        """Take a matrix from an answer.

        Raises:
            PolicyUnavailableError: If there is none.
        """
        array = answer.get(name)
        if not isinstance(array, np.ndarray) or array.ndim != 2:
            told = f"shape {array.shape}" if isinstance(array, np.ndarray) else sorted(answer)
            raise PolicyUnavailableError(
                f"{self.address}: an answer must hold {name} of shape (n, A); got {told}"
            )
        return array

    def _receive(self, seconds: float) -> dict[str, Any]:
        assert self._socket is not None
        try:
            answer = self._socket.recv(timeout=seconds)
        except TimeoutError as err:
            self.close()
            raise PolicyUnavailableError(f"{self.address}: no answer in {seconds:g} s") from err
        except (OSError, WebSocketException) as err:
            self.close()
            raise PolicyUnavailableError(f"{self.address}: the connection is lost: {err}") from err
        if isinstance(answer, str):
            last = answer.strip().splitlines()[-1] if answer.strip() else "an empty text"
            raise PolicyUnavailableError(f"{self.address}: the server failed: {last}")
        try:
            told = unpack(answer)
        except ValueError as err:
            raise PolicyUnavailableError(f"{self.address}: {err}") from err
        if not isinstance(told, dict):
            raise PolicyUnavailableError(
                f"{self.address}: an answer must be a map; got {told!r:.80}"
            )
        return told


class RemotePolicy:
    """A policy of somebody else's server; implements `dgl_tasks.policy.Policy`.

    It is sent `observation/image`, `observation/state`, the arrays of `Policy` by their names, and
    `prompt`.
    """

    def __init__(self, connection: Connection, prompt: str) -> None:
        """Take a connection, and the task in words."""
        self._connection, self._prompt = connection, prompt
        self._garment: np.ndarray | None = None

    def reset(self, observation: Arrays) -> None:
        """Begin an episode."""
        self._connection.open()
        self._garment = observation["garment_point_cloud"]

    def act(self, observation: Arrays) -> np.ndarray:
        """Ask for the next actions."""
        message: dict[str, object] = {f"observation/{k}": v for k, v in observation.items()}
        message["observation/state"] = observation["joint_state"]
        if self._garment is not None:  # the first of an episode
            message["observation/garment_point_cloud"] = self._garment
            message["reset"] = True
            self._garment = None
        return self._connection.ask_actions({**message, "prompt": self._prompt})


class RemoteStage:
    """A policy of one stage on a server of ours; implements `policy_actor.StagePolicy`."""

    def __init__(self, connection: Connection, stage: str) -> None:
        """Take a connection, and the name of the stage."""
        self._connection, self._stage = connection, stage
        self._begins: dict[str, object] | None = None
        self._past: list[Arrays] = []

    def reset(self, observation: Arrays, *, seed: int | None = None) -> None:
        """Begin the stage."""
        self._begins = {"constant": dict(observation), "seed": seed}
        self._past = []

    def observe(self, observation: Arrays) -> None:
        """Keep an observation for the next question."""
        self._past.append(observation)

    def act(self, observation: Arrays) -> np.ndarray:
        """Ask for the next joint targets."""
        past, self._past = [dict(each) for each in self._past], []
        begins, self._begins = self._begins, None
        return self._connection.ask_actions(
            {
                "stage": self._stage,
                "begins": begins,
                "past": past,
                "observation": dict(observation),
            }
        )


@dataclass(frozen=True, kw_only=True)
class RemoteHandWay:
    """Way of one hand; implements `dgl_collect.skill.HandWay`."""

    points: np.ndarray
    turns: np.ndarray
    poses: np.ndarray


@dataclass(frozen=True, kw_only=True)
class RemoteWay:
    """Ways of the working hands; implements `dgl_collect.skill.Way`."""

    hands: Mapping[str, RemoteHandWay]
    spread: float


@dataclass(frozen=True, kw_only=True)
class RemoteSkill:
    """A skill on a server of ours; implements `dgl_collect.skill.Skill`."""

    connection: Connection

    def plan(
        self, stage: str, starts: Mapping[Side, np.ndarray], anchors: Mapping[str, np.ndarray]
    ) -> RemoteWay:
        """Ask for the ways of a stage.

        Raises:
            PolicyUnavailableError: If the server fails, or answers with something else.
        """
        answer = self.connection.ask(
            {
                "stage": stage,
                "starts": {str(side): start for side, start in starts.items()},
                "anchors": dict(anchors),
            }
        )
        hands, spread = answer.get("hands"), answer.get("spread")
        if not isinstance(hands, dict) or not set(starts) <= set(hands):
            raise PolicyUnavailableError(
                f"{self.connection.address}: an answer must hold the ways of the hands "
                f"{sorted(map(str, starts))}; got {sorted(answer)}"
            )
        if not isinstance(spread, float):
            raise PolicyUnavailableError(
                f"{self.connection.address}: an answer must hold a spread [m]; got {spread!r:.80}"
            )
        return RemoteWay(
            hands={
                side: RemoteHandWay(**{name: self.connection.take(way, name) for name in WAY_NAMES})
                for side, way in hands.items()
            },
            spread=spread,
        )


def check_served(connection: Connection, task: Task, cloud: str) -> None:
    """Check that a server of ours, which tells its task, serves the wanted one.

    Raises:
        ValueError: If it serves another task, or its policy sees other clouds.
    """
    told = connection.metadata
    for name, value in (("task", task.id), ("cloud", cloud)):
        if told.get("protocol") in (STAGES, SKILL) and told.get(name, value) != value:
            raise ValueError(f"{connection.address} serves the {name} {told[name]}; got {value}")


def make_remote_method(setup: Setup, options: EvaluationOptions) -> Method:
    """Make the method of a policy server: in stages for ours, from the parked arms for others.

    Raises:
        PolicyUnavailableError: If no policy server answers.
        ValueError: If it serves another task, or its policy sees other clouds.
    """
    connection = Connection(options.policy)
    connection.open()
    told, task = connection.metadata, setup.env.task
    if told.get("protocol") not in (STAGES, SKILL):
        return FromStart(
            policy=RemotePolicy(connection, task.description),
            actions=options.actions,
            control_mode=options.control_mode,
        )
    check_served(connection, task, setup.env.cloud)
    if told["protocol"] == SKILL:
        return setup.make_runner(
            Expert(follows_steps=False),
            demonstration=follow_recordings(setup.demonstration),
            skill=RemoteSkill(connection=connection),
        )
    policies = {
        name: Learned(policy=RemoteStage(connection, name), chunks=options.chunks or chunks)
        for name, chunks in told["stages"].items()
    }
    return setup.make_runner(PolicyActor(policies=policies, is_sent=told["is_sent"]))
