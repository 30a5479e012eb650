"""Server of policies that act in the stages of a task."""

import http
import traceback
from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import Any

from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response
from websockets.sync.server import Server, ServerConnection, serve

from dgl_collect.policy_actor import Learned
from dgl_collect.remote.client import STAGES
from dgl_collect.remote.wire import pack, unpack

__all__ = ["LARGEST_QUESTION", "PolicyServer"]

LARGEST_QUESTION = 2**26
"""Largest message of a client [bytes]."""


class PolicyServer:
    """Serves the policies of a task; each connection has runners of its own."""

    def __init__(
        self,
        make_policies: Callable[[], Mapping[str, Learned]],
        *,
        task: str,
        cloud: str,
        is_sent: bool,
        host: str = "127.0.0.1",
        port: int = 8000,
    ) -> None:
        """Bind the server; `run` serves.

        Args:
            make_policies: Makes the policies by name of the stage, for one connection.
            task: Environment id.
            cloud: Kind of clouds that they see.
            is_sent: Hands begin at matched points.
            host: Address to listen at; others than this machine reach it at "0.0.0.0" only.
            port: To listen at; 0 takes a free one.

        Raises:
            OSError: If the port is taken, or the address is not of this machine.
        """
        self._make_policies = make_policies
        stages = {name: learned.chunks for name, learned in make_policies().items()}
        self._metadata = {
            "protocol": STAGES,
            "task": task,
            "cloud": cloud,
            "is_sent": is_sent,
            "stages": stages,
        }
        self._server: Server = serve(
            self._answer,
            host,
            port,
            compression=None,
            max_size=LARGEST_QUESTION,
            process_request=_tell_health,
        )
        self.port: int = self._server.socket.getsockname()[1]
        """Port that it listens at."""

    def run(self) -> None:
        """Serve until `stop` is called, or an interrupt comes."""
        self._server.serve_forever()

    def stop(self) -> None:
        """Stop serving."""
        self._server.shutdown()

    def _answer(self, connection: ServerConnection) -> None:
        """Serve a client until it leaves, however that is."""
        with suppress(ConnectionClosed):
            self._serve(connection)

    def _serve(self, connection: ServerConnection) -> None:
        policies = self._make_policies()
        connection.send(pack(self._metadata))
        for message in connection:
            try:
                actions = _act(policies, unpack(message if isinstance(message, bytes) else b""))
            except Exception:  # whatever is wrong is the client's to know
                connection.send(traceback.format_exc())
                return
            connection.send(pack({"actions": actions}))


def _act(policies: Mapping[str, Learned], message: Any) -> object:
    """Let the policy of a stage take the observations, and act."""
    if not isinstance(message, dict) or message.get("stage") not in policies:
        raise ValueError(f"a message must name one of the stages {sorted(policies)}")
    policy = policies[message["stage"]].policy
    if message.get("begins"):
        policy.reset(message["begins"]["constant"], seed=message["begins"]["seed"])
    for observation in message.get("past", ()):
        policy.observe(observation)
    return policy.act(message["observation"])


def _tell_health(connection: ServerConnection, request: Request) -> Response | None:
    if request.path == "/healthz":
        return connection.respond(http.HTTPStatus.OK, "OK\n")
    return None
