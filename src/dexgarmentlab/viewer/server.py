"""The viewer's server."""

import time
from typing import TYPE_CHECKING

from dgl_collect.errors import MissingPackageError

if TYPE_CHECKING:
    from viser import ViserServer

__all__ = ["make_server", "wait"]

CAMERA, TARGET = (1.6, 2.6, 2.0), (0.0, 0.6, 0.3)
"""Place of the camera at the beginning, and where it looks [m]."""


def make_server(host: str, port: int) -> "ViserServer":
    """Start a server without content.

    Args:
        host: Address to listen at.
        port: Port to listen at; the next free one if it is taken.

    Raises:
        MissingPackageError: If viser is not installed.
    """
    try:
        import viser
    except ImportError as err:
        raise MissingPackageError("viser", "dexgarmentlab[viewer]") from err
    server = viser.ViserServer(host=host, port=port, label="dexgarmentlab", verbose=False)
    server.scene.set_up_direction("+z")
    server.initial_camera.position, server.initial_camera.look_at = CAMERA, TARGET
    server.gui.configure_theme(show_logo=False, show_share_button=False)
    server.gui.main_panel.dock_right()
    return server


def wait() -> None:
    """Let the server work until an interrupt."""
    try:
        while True:
            time.sleep(0.2)
    except KeyboardInterrupt:
        pass
