# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The command serve: a process that answers until it is told to end."""

import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest

from cli import error_of
from fleet_service import KEY, LENGTH, add_places
from fusionslam.cli import failures
from fusionslam.service.config import ServiceConfig
from rows import rows
from running_services import PATIENCE_S, ask, assert_closed, connect, serving_in_a_thread


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


@pytest.mark.slow
def test_a_process_answers_and_ends_cleanly_on_sigterm(made: Path, tmp_path: Path) -> None:
    httpx = pytest.importorskip("httpx")
    add_places(made, "odd", 3, site="per%cent")
    keys = tmp_path / "keys"
    keys.write_text(f"red {KEY}\n")
    head = {"Authorization": f"Bearer {KEY}"}
    with (
        served(made, "--api-keys", keys) as (process, url),
        httpx.Client(base_url=url, timeout=PATIENCE_S) as client,
    ):
        assert client.get("/health").json() == {"status": "ready", "places": 23}
        assert client.get("/v1/places").status_code == 401
        query = client.post("/v1/query", json={"vector": [0.0] * LENGTH}, headers=head)
        assert len(query.json()["results"][0]) == 10
        assert client.get("/v1/sites/per%25cent", headers=head).json()["places"] == 3
        assert "server" not in query.headers
        client.close()
        with begun_query(url) as (line, rest_of_body):
            # What is answered later shows that the query was begun: only such ones are finished.
            assert httpx.get(f"{url}/health").status_code == 200
            process.send_signal(signal.SIGTERM)
            wait_until_closed(url)
            line.sendall(rest_of_body)
            assert line.recv(100).startswith(b"HTTP/1.1 200")  # it is finished
        rest, errors = process.communicate(timeout=PATIENCE_S)
    assert (process.returncode, rest, errors) == (0, "ended\n", "")


def wait_until_closed(url: str) -> None:
    """Until nobody listens any more."""
    while True:
        try:
            connect(url).close()
            time.sleep(0.02)
        except OSError:
            return


def test_slow_bodies_are_cut_off_and_ctrl_c_ends_the_service(made: Path) -> None:
    from fusionslam.service.app import create_app
    from fusionslam.service.listening import listen, serve, url_of

    httpx = pytest.importorskip("httpx")
    config, answers = ServiceConfig(port=0, body_timeout_s=0.2), []
    head = b"POST /v1/locate?format=bin HTTP/1.1\r\nHost: localhost\r\nContent-Length: 99\r\n\r\n"

    def interrupt() -> None:
        try:
            answers.append(httpx.get(f"{url}/health", timeout=PATIENCE_S).json()["status"])
            for data in (head + b"x" * 16, b"no request at all\r\n\r\n"):
                with connect(url) as line:
                    line.sendall(data)
                    answers.append(line.recv(100).split()[1])
        finally:
            os.kill(os.getpid(), signal.SIGINT)

    with listen(config) as listener:
        url = url_of(listener)
        threading.Thread(target=interrupt).start()
        serve(create_app(made, config), listener)
    assert answers == ["ready", b"408", b"400"]
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_heads_that_do_not_come_in_time_end_the_connection(twenty: Path) -> None:
    with serving_in_a_thread(twenty, head_timeout_s=0.2) as url:
        for sent in (b"", b"GET / HTT", b"GET / HTTP/1.1\r\nA: b"):
            line = connect(url)
            with suppress(OSError):  # this process may be held up until it is closed
                line.sendall(sent)
            assert_closed(line)
        answer = 0
        while answer != 200:  # likewise
            line = connect(url)
            with suppress(OSError):
                answer = ask(line)
        with suppress(OSError):
            line.sendall(b"\r\nGET")  # the head of another request, which ends nothing
        assert_closed(line)


def test_of_too_many_connections_idle_ones_make_room(twenty: Path) -> None:
    with serving_in_a_thread(twenty, max_connections=8, head_timeout_s=PATIENCE_S) as url:
        good = connect(url)
        assert ask(good) == 200
        idle = [connect(url) for _ in range(20)]
        with connect(url) as other:
            assert ask(other) == 200
        assert ask(good) == 200
        for line in idle[:13]:
            assert_closed(line)
        for line in (good, *idle[13:]):
            line.close()


@contextmanager
def begun_query(url: str) -> Iterator[tuple[socket.socket, bytes]]:
    """Yield a connection with a query that was sent in part, and the rest of it."""
    body = b'{"vector": [' + b",".join([b"0"] * LENGTH) + b"]}"
    head = f"POST /v1/query HTTP/1.1\r\nHost: localhost\r\nContent-Length: {len(body)}\r\n"
    head += f"Authorization: Bearer {KEY}\r\nContent-Type: application/json\r\n\r\n"
    with connect(url) as line:
        line.sendall(head.encode() + body[:50])
        yield line, body[50:]


def test_a_port_in_use_is_named_with_a_cure(twenty: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        error = error_of(2, "serve", twenty, "--port", port)
    assert (error.code, error.fields) == ("port-in-use", ("127.0.0.1", str(port)))


@rows(
    "code, options",
    [
        ("no-keys", ("--host", "0.0.0.0")),
        ("no-host", ("--host", "no.such.host.invalid", "--without-keys")),
        ("no-host", ("--host", "192.0.2.1", "--without-keys")),
        ("config-file", ("--api-keys", "nowhere")),
        ("config", ("--set", "service.max_k=0")),
    ],
)
def test_wrong_options_are_named(twenty: Path, code: str, options: tuple[str, ...]) -> None:
    assert error_of(2, "serve", twenty, *options).code == code


def test_a_folder_without_places_is_named(tmp_path: Path) -> None:
    for name in ("", "nowhere"):
        error = error_of(1, "serve", tmp_path / name)
        assert str(tmp_path) in str(error)


def test_a_missing_extra_is_named(twenty: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(failures, "find_spec", lambda name: None)
    error = error_of(1, "serve", twenty)
    assert (error.code, error.fields) == ("missing-extra", ("fleet",))
