# SPDX-License-Identifier: MIT
"""One page, served on this machine alone, and one question that it may ask."""

from __future__ import annotations

import json
import webbrowser
from collections.abc import Callable
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

from ..core.errors import InputError

LIMIT = 1_000_000
"""Bytes of a question."""


def serve(page: bytes, port: int, browser: bool, tell: Callable[[str], object], answer: Callable[[str], dict[str, Any]]) -> None:
    """Serve a page until interrupted.

    Parameters
    ----------
    page : bytes
        HTML in UTF-8.
    port : int
        Of this machine; 0 for any that is free.
    browser : bool
        Whether to open it.
    tell : callable
        Is told the address.
    answer : callable
        Of a text that the page posts, to what it gets as JSON.

    Raises
    ------
    InputError
        If the port cannot be had.
    """

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:  # the name is the library's
            """The page, whatever is asked for."""
            self._send(page, "text/html; charset=utf-8")

        def do_POST(self) -> None:
            """An answer, if the page itself asks."""
            length = int(self.headers.get("Content-Length", 0))
            if self.headers.get("Origin") != address.rstrip("/") or length > LIMIT:
                self.send_error(403)
                return
            self._send(json.dumps(answer(self.rfile.read(length).decode())).encode(), "application/json")

        def _send(self, data: bytes, kind: str) -> None:
            self.send_response(200)
            self.send_header("Content-Type", kind)
            self.send_header("Content-Length", str(len(data)))
            self.end_headers()
            self.wfile.write(data)

        def log_message(self, format: str, *arguments: object) -> None:
            """Nothing."""

    try:
        server = ThreadingHTTPServer(("127.0.0.1", port), Handler)
    except OSError as error:
        raise InputError(f"--port {port}: cannot be had ({error.strerror}); give another one, or none.") from error
    with server:
        address = f"http://127.0.0.1:{server.server_port}/"
        tell(address)
        if browser:
            webbrowser.open(address)
        server.serve_forever()
