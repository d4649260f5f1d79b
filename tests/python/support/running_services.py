# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""A service of this process on a socket of its own, and plain connections to it."""

import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext, suppress
from http.client import HTTPResponse
from pathlib import Path
from typing import Any

import pytest

from fusionslam.service.config import ServiceConfig

PATIENCE_S = 300


@contextmanager
def serving_in_a_thread(folder: Path, **limits: Any) -> Iterator[str]:
    """Yield the address of a service of this process."""
    uvicorn = pytest.importorskip("uvicorn")
    from fusionslam.service import listening
    from fusionslam.service.app import create_app

    config = ServiceConfig(port=0, **limits)
    servers: list[Any] = []

    class Server(uvicorn.Server):  # type: ignore[misc, name-defined]
        def __init__(self, *args: Any) -> None:
            super().__init__(*args)
            servers.append(self)

    with listening.listen(config) as listener, pytest.MonkeyPatch.context() as patched:
        patched.setattr(uvicorn, "Server", Server)
        patched.setattr(listening, "_ending", nullcontext)
        app = create_app(folder, config)
        thread = threading.Thread(target=listening.serve, args=(app, listener, config))
        thread.start()
        try:
            yield listening.url_of(listener)
        finally:
            servers[0].should_exit = True
            thread.join()


def connect(url: str, source: str = "127.0.0.1") -> socket.socket:
    host, port = url.removeprefix("http://").split(":")
    return socket.create_connection((host, int(port)), PATIENCE_S, (source, 0))


def ask(line: socket.socket, path: str = "/health", more: str = "") -> int:
    """Send a request and read its whole answer; return the status."""
    line.sendall(f"GET {path} HTTP/1.1\r\nHost: localhost\r\n{more}\r\n".encode())
    answer = HTTPResponse(line)
    answer.begin()
    answer.read()
    return answer.status


def assert_closed(line: socket.socket) -> None:
    with line, suppress(ConnectionResetError):
        while line.recv(1000):
            pass
