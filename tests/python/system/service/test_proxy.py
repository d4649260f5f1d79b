# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""HAProxy in front of the service, as deploy/ configures it."""

import itertools
import os
import shutil
import socket
import subprocess
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from http.client import BadStatusLine
from pathlib import Path

import pytest

from rows import rows
from running_services import ask, connect, serving_in_a_thread

HAPROXY = shutil.which("haproxy")
CONFIG = Path(__file__).parents[4] / "deploy/haproxy.cfg"
GREEDY = "127.0.0.2"

pytestmark = pytest.mark.skipif(HAPROXY is None, reason="HAProxy is not installed")


@contextmanager
def proxied(url: str, **more: str) -> Iterator[str]:
    """Yield the address of a proxy in front of a service."""
    with socket.create_server(("127.0.0.1", 0)) as listener:  # which it takes over
        port = listener.getsockname()[1]
        environment = os.environ | {
            "PLACES_BIND": f"fd@{listener.fileno()}",
            "PLACES_SERVER": url.removeprefix("http://"),
            **more,
        }
        process = subprocess.Popen(
            [str(HAPROXY), "-db", "-q", "-f", CONFIG],
            env=environment,
            pass_fds=[listener.fileno()],
        )
    try:
        yield f"http://127.0.0.1:{port}"
    finally:
        process.kill()
        process.wait()


def test_an_address_with_too_many_connections_takes_nothing_from_others(twenty: Path) -> None:
    with (
        serving_in_a_thread(twenty, behind_proxy=True) as url,
        proxied(url, PLACES_CONNECTIONS="5") as proxy,
        ExitStack() as lines,
    ):
        with pytest.raises((ConnectionError, BadStatusLine)):
            while True:  # what is open too long is closed, so that more than five may be tried
                ask(lines.enter_context(connect(proxy, source=GREEDY)))
        with connect(proxy) as good:
            assert ask(good) == 200


def test_an_address_that_a_client_claims_is_not_believed(twenty: Path) -> None:
    with (
        serving_in_a_thread(twenty, behind_proxy=True, requests_per_minute=2) as url,
        proxied(url) as proxy,
    ):
        answers = []
        for number, source in enumerate(("127.0.0.1", "127.0.0.1", "127.0.0.1", GREEDY)):
            with connect(proxy, source=source) as line:
                claim = f"X-Forwarded-For: 9.9.9.{number}\r\n"
                answers.append(ask(line, "/v1/places", claim))
    assert answers == [200, 200, 429, 200]


@rows("limit", ["KEY", "ADDRESS"])
def test_who_asks_too_often_is_turned_away_before_the_service(limit: str, twenty: Path) -> None:
    rate = {f"PLACES_{limit}_RATE": "5"}
    with serving_in_a_thread(twenty, behind_proxy=True) as url, proxied(url, **rate) as proxy:
        with connect(proxy, source=GREEDY) as greedy:
            for number in itertools.count():
                key = "greedy" if limit == "KEY" else f"guess {number}"
                status = ask(greedy, "/health", f"Authorization: Bearer {key}\r\n")
                if status != 200:
                    break
        assert number >= 5 and status == 429
        with connect(proxy) as good:
            assert ask(good, "/health", "Authorization: Bearer good\r\n") == 200
