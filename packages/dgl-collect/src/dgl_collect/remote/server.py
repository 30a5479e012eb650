"""Server of policies of ours."""

import http
import traceback
from collections.abc import Callable
from contextlib import suppress

from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response
from websockets.sync.server import Server, ServerConnection, serve

from dgl_collect.remote.served import Served
from dgl_collect.remote.wire import pack, unpack

__all__ = ["LARGEST_QUESTION", "PolicyServer"]

LARGEST_QUESTION = 2**26
"""Largest message of a client [bytes]."""


class PolicyServer:
    """Serves a policy; each connection has one of its own."""

    def __init__(
        self, make_served: Callable[[], Served], *, host: str = "127.0.0.1", port: int = 8000
    ) -> None:
        """Bind the server; `run` serves.

        Args:
            make_served: Makes what answers the messages of one connection.
            host: Address to listen at; others than this machine reach it at "0.0.0.0" only.
            port: To listen at; 0 takes a free one.

        Raises:
            OSError: If the port is taken, or the address is not of this machine.
        """
        self._make_served = make_served
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
        served = self._make_served()
        connection.send(pack(served.metadata))
        for message in connection:
            try:
                asked = unpack(message if isinstance(message, bytes) else b"")
                if not isinstance(asked, dict):
                    raise ValueError(f"a message must be a map; got {asked!r:.80}")
                answer = pack(served.answer(asked))
            except Exception:  # whatever is wrong is the client's to know
                connection.send(traceback.format_exc())
                return
            connection.send(answer)


def _tell_health(connection: ServerConnection, request: Request) -> Response | None:
    if request.path == "/healthz":
        return connection.respond(http.HTTPStatus.OK, "OK\n")
    return None
