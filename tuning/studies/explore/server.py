"""The page's server: on this computer alone, at a port that is free."""

from __future__ import annotations

import socket
from collections.abc import Callable

from bokeh.application import Application
from bokeh.application.handlers.function import FunctionHandler
from bokeh.document import Document
from bokeh.server.server import Server

HOST = "127.0.0.1"  # nobody else reaches it, and pages of other addresses may not talk to it
ATTEMPTS = 5  # at a port that another process may take first


def serve(page: Callable[[Document], None], ready: Callable[[str], None]) -> None:
    """Serve a page until interrupted.

    Args:
        page: fills the document of each browser tab.
        ready: told the address once it can be opened.

    Raises:
        OSError: no port can be had.
        KeyboardInterrupt: Ctrl-C; it does not end otherwise.
    """
    server = _server(Application(FunctionHandler(page)))
    server.start()
    try:
        ready(f"http://{HOST}:{server.port}/")
        server.io_loop.start()
    finally:
        server.stop()


def _server(application: Application) -> Server:
    """A server whose port is known to it before it listens: it answers to its own address alone."""
    for left in reversed(range(ATTEMPTS)):
        with socket.socket() as free:
            free.bind((HOST, 0))
            port = free.getsockname()[1]
        try:
            own = [f"{HOST}:{port}", f"localhost:{port}"]
            return Server({"/": application}, address=HOST, port=port, allow_websocket_origin=own)
        except OSError:
            if not left:
                raise
    raise AssertionError("ATTEMPTS is at least 1")
