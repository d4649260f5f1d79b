# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The command serve: a process that answers until it is told to end."""

import os
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from cli import error_of
from fleet_service import KEY, LENGTH, add_places
from fusionslam.service.config import ServiceConfig


@contextmanager
def served(folder: Path, *options: object) -> Iterator[tuple["subprocess.Popen[str]", str]]:
    """Yield the process of the command and its address; it is ended if the test did not."""
    words = [sys.executable, "-m", "fusionslam", "serve", folder, "--port", "0", *options]
    process = subprocess.Popen(
        [str(word) for word in words],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONWARNINGS": "ignore"},
    )
    try:
        assert process.stdout is not None
        line = process.stdout.readline()
        assert line.startswith("http://"), (line, process.communicate())
        yield process, line.split(": ")[0]
    finally:
        process.kill()
        process.wait()


def test_a_process_answers_and_ends_cleanly_on_sigterm(made: Path, tmp_path: Path) -> None:
    httpx = pytest.importorskip("httpx")
    add_places(made, "odd", 3, site="per%cent")
    keys = tmp_path / "keys"
    keys.write_text(f"red {KEY}\n")
    head = {"Authorization": f"Bearer {KEY}"}
    options = ("--api-keys", keys, "--set", "service.body_timeout_s=2")
    with served(made, *options) as (process, url), httpx.Client(base_url=url) as client:
        assert client.get("/health").json() == {"status": "ready", "places": 23}
        assert client.get("/v1/places").status_code == 401
        query = client.post("/v1/query", json={"vector": [0.0] * LENGTH}, headers=head)
        assert len(query.json()["results"][0]) == 10
        assert client.get("/v1/sites/per%25cent", headers=head).json()["places"] == 3
        assert "server" not in query.headers
        assert b"408" in answer_to_slow_body(url)
        assert b"400" in answer_to(url, b"no request at all\r\n\r\n")
        with begun_query(url) as (line, rest_of_body):
            threading.Timer(0.2, lambda: process.send_signal(signal.SIGTERM)).start()
            threading.Timer(0.4, lambda: line.sendall(rest_of_body)).start()
            assert line.recv(100).startswith(b"HTTP/1.1 200")  # it is finished
        rest, errors = process.communicate(timeout=30)
    assert (process.returncode, rest, errors) == (0, "ended\n", "")


def test_ctrl_c_ends_the_service(made: Path) -> None:
    from fusionslam.service.app import create_app
    from fusionslam.service.listening import listen, serve, url_of

    config = ServiceConfig(port=0)

    def interrupt() -> None:
        wait_for(url)
        os.kill(os.getpid(), signal.SIGINT)

    with listen(config) as listener:
        url = url_of(listener)
        threading.Thread(target=interrupt).start()
        serve(create_app(made, config), listener)
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def wait_for(url: str) -> None:
    httpx = pytest.importorskip("httpx")
    assert httpx.get(f"{url}/health", timeout=30).json()["status"] == "ready"


@contextmanager
def begun_query(url: str) -> Iterator[tuple[socket.socket, bytes]]:
    """Yield a connection with a query that was sent in part, and the rest of it."""
    host, port = url.removeprefix("http://").split(":")
    body = b'{"vector": [' + b",".join([b"0"] * LENGTH) + b"]}"
    head = f"POST /v1/query HTTP/1.1\r\nHost: localhost\r\nContent-Length: {len(body)}\r\n"
    head += f"Authorization: Bearer {KEY}\r\nContent-Type: application/json\r\n\r\n"
    with socket.create_connection((host, int(port)), timeout=20) as line:
        line.sendall(head.encode() + body[:50])
        yield line, body[50:]


def answer_to_slow_body(url: str) -> bytes:
    head = b"POST /v1/describe?format=bin HTTP/1.1\r\nHost: localhost\r\nContent-Length: 160\r\n"
    return answer_to(url, head + f"Authorization: Bearer {KEY}\r\n\r\n".encode() + b"x" * 16)


def answer_to(url: str, data: bytes) -> bytes:
    """Return how the answer to some bytes begins."""
    host, port = url.removeprefix("http://").split(":")
    with socket.create_connection((host, int(port)), timeout=20) as line:
        line.sendall(data)
        return line.recv(100)


def test_a_port_in_use_is_named_with_a_cure(made: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        error = error_of(2, "serve", made, "--port", port)
    assert (error.code, error.fields) == ("port-in-use", ("127.0.0.1", str(port)))


@pytest.mark.parametrize(
    ("options", "status", "code"),
    [
        (("--host", "0.0.0.0"), 2, "no-keys"),
        (("--host", "no.such.host.invalid", "--without-keys"), 2, "no-host"),
        (("--host", "192.0.2.1", "--without-keys"), 2, "no-host"),
        (("--api-keys", "nowhere"), 2, "config-file"),
        (("--set", "service.max_k=0"), 2, "config"),
    ],
)
def test_options_that_cannot_be_followed_are_named(
    made: Path, options: Any, status: int, code: str
) -> None:
    assert error_of(status, "serve", made, *options).code == code


def test_a_folder_without_places_is_named(tmp_path: Path) -> None:
    for name in ("", "nowhere"):
        error = error_of(1, "serve", tmp_path / name)
        assert str(tmp_path) in str(error)


def test_a_missing_extra_is_named(made: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from fusionslam.cli import failures

    monkeypatch.setattr(failures, "find_spec", lambda name: None)
    error = error_of(1, "serve", made)
    assert (error.code, error.fields) == ("missing-extra", ("fleet",))
