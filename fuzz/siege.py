# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Good clients ask the service while others hold its connections: how long do the good ones wait?

The others are 1,000 that are idle, 200 that send a byte a second, and 128 of one key that are
greedy: half of them leave bodies unsent, half ask for descriptions as fast as they can. HAProxy
stands in front of the service as in ``deploy/`` where it is installed.
"""

import asyncio
import json
import os
import resource
import secrets
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Coroutine, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from benchmarks.fleet.http_client import request_of
from benchmarks.fleet.service_load import make_places, serving, some_vectors
from fuzz import PROJECT

IDLE, SLOW, GREEDY, GOOD = 1000, 200, 128, 16
PLACES = 20_000
_PAUSE_S = 0.5
"""Between the questions of a good client."""
_BEGUN_S = 5.0
"""Until all others have their connections."""
_SOURCES = 20
"""Addresses of idle and of slow clients; an address has at most 100 connections."""


@dataclass(frozen=True)
class Siege:
    """What the good clients met.

    Attributes:
        answers: number of those during the siege.
        alone_ms, during_ms: the time that 95 % of answers took at most.
        wrong: answers of another status, or of other places than without the others.
        front: what stood in front of the service.
    """

    answers: int
    alone_ms: float
    during_ms: float
    wrong: int
    front: str


class _Answer(NamedTuple):
    seconds: float
    status: int
    body: bytes


def besiege_service(seconds: float, places: int = PLACES) -> Siege:
    """Ask alone for some time, and as long during a siege by another process."""
    limit = resource.getrlimit(resource.RLIMIT_NOFILE)[1]
    resource.setrlimit(resource.RLIMIT_NOFILE, (min(8000, limit), limit))
    good = [secrets.token_hex(16) for _ in range(GOOD)]
    bad = secrets.token_hex(16)
    haproxy = shutil.which("haproxy")
    with tempfile.TemporaryDirectory() as name:
        folder, keys = Path(name) / "places", Path(name) / "keys"
        make_places(folder, places)
        named = [*((f"good{number}", key) for number, key in enumerate(good)), ("bad", bad)]
        keys.write_text("".join(f"{name} {key}\n" for name, key in named))
        more: dict[str, object] = {"requests_per_minute": 600}
        if haproxy:
            more["behind_proxy"] = "true"
        with serving(folder, keys, **more) as (_, own), _in_front(haproxy, own) as port:
            asyncio.run(_ask_for(2.0, port, good))  # warms it up
            alone = asyncio.run(_ask_for(seconds, port, good))
            with _others(port, bad):
                time.sleep(_BEGUN_S)
                during = asyncio.run(_ask_for(seconds, port, good))
    right = {answer.body for answer in alone if answer.status == 200}
    wrong = sum(one.status != 200 or one.body not in right for one in during)
    times = [[1e3 * one.seconds for one in some] for some in (alone, during)]
    before, then = (float(np.percentile(some, 95)) for some in times)
    front = "HAProxy in front" if haproxy else "without HAProxy, which is not installed here"
    return Siege(len(during), before, then, wrong, front)


@contextmanager
def _in_front(haproxy: str | None, port: int) -> Iterator[int]:
    """Yield the port of HAProxy, or that of the service."""
    if haproxy is None:
        yield port
        return
    with socket.create_server(("127.0.0.1", 0)) as listener:  # which it takes over
        front = listener.getsockname()[1]
        about = {"PLACES_BIND": f"fd@{listener.fileno()}", "PLACES_SERVER": f"127.0.0.1:{port}"}
        process = subprocess.Popen(
            [haproxy, "-db", "-q", "-f", str(PROJECT / "deploy" / "haproxy.cfg")],
            env=os.environ | about,
            pass_fds=[listener.fileno()],
        )
    try:
        yield front
    finally:
        process.kill()
        process.wait()


async def _ask_for(seconds: float, port: int, keys: Sequence[str]) -> list[_Answer]:
    """Let the good clients ask one after another; return all answers."""
    vector = some_vectors(1)[0].tolist()
    body = json.dumps({"vector": vector}).encode()
    answers: list[_Answer] = []
    end = time.perf_counter() + seconds

    async def client(number: int, key: str) -> None:
        request = request_of("POST", "/v1/query?k=3", body, key=key, kind="application/json")
        await asyncio.sleep(_PAUSE_S * number / GOOD)
        while (began := time.perf_counter()) < end:
            try:
                status, content = await _answer(port, request, "127.0.0.1")
            except (OSError, EOFError) as error:
                status, content = 0, repr(error).encode()
            answers.append(_Answer(time.perf_counter() - began, status, content))
            await asyncio.sleep(_PAUSE_S)

    await asyncio.gather(*(client(number, key) for number, key in enumerate(keys)))
    return answers


async def _answer(port: int, request: bytes, source: str) -> tuple[int, bytes]:
    reader, writer = await _connect(port, source)
    try:
        writer.write(request)
        await writer.drain()
        head = (await reader.readuntil(b"\r\n\r\n")).lower()
        length = int(head.split(b"content-length: ")[1].split(b"\r\n")[0])
        return int(head.split()[1]), await reader.readexactly(length)
    finally:
        writer.close()


async def _connect(port: int, source: str) -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
    return await asyncio.open_connection("127.0.0.1", port, local_addr=(source, 0))


@contextmanager
def _others(port: int, key: str) -> Iterator[None]:
    """The clients that are idle, slow or greedy, in a process of their own."""
    command = [sys.executable, "-m", "fuzz.siege", str(port), key]
    process = subprocess.Popen(command, cwd=PROJECT)
    try:
        yield
    finally:
        process.send_signal(signal.SIGKILL)
        process.wait()


async def _besiege(port: int, key: str) -> None:
    """Be all clients that are not good, for ever."""
    cloud = np.random.default_rng(0).uniform(-20, 20, (20_000, 4)).astype(np.float32).tobytes()
    describe = request_of("POST", "/v1/describe?format=bin", cloud, key=key)
    unsent = request_of("POST", "/v1/query?k=3", bytes(999), key=key)[:-500]

    async def idle(source: str) -> None:
        reader, writer = await _connect(port, source)
        await reader.read(1)
        writer.close()

    async def slow(source: str) -> None:
        _, writer = await _connect(port, source)
        for byte in b"GET /health HTTP/1.1\r\nX: " + b"a" * 200:
            writer.write(bytes([byte]))
            await writer.drain()
            await asyncio.sleep(1)

    async def leave_unsent(source: str) -> None:
        reader, writer = await _connect(port, source)
        writer.write(unsent)
        await reader.read(10)
        writer.close()

    async def demand(source: str) -> None:
        if (await _answer(port, describe, source))[0] == 503:
            await asyncio.sleep(1)

    await asyncio.gather(
        *(_again(idle, 2 + number % _SOURCES) for number in range(IDLE)),
        *(_again(slow, 30 + number % _SOURCES) for number in range(SLOW)),
        *(_again(leave_unsent, 60) for _ in range(GREEDY // 2)),
        *(_again(demand, 61) for _ in range(GREEDY // 2)),
    )


Client = Callable[[str], Coroutine[Any, Any, None]]


async def _again(client: Client, number: int) -> None:
    while True:
        with suppress(OSError, EOFError, IndexError):
            await client(f"127.0.0.{number}")
        await asyncio.sleep(0.2)


if __name__ == "__main__":
    limit = resource.getrlimit(resource.RLIMIT_NOFILE)[1]
    resource.setrlimit(resource.RLIMIT_NOFILE, (min(8000, limit), limit))
    asyncio.run(_besiege(int(sys.argv[1]), sys.argv[2]))
