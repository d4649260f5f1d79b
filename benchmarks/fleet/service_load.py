# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Does the service hold while many robots ask, and others send what is wrong?

    python -m benchmarks.fleet.service_load                  # 64 clients for a minute
    python -m benchmarks.fleet.service_load --rate 0         # each asks again at once

It starts ``fusionslam serve`` on made places with an index. Each client asks with a vector so many
times a second; in between it sends requests that are malformed, too long, or without a right key.
Times count from when a request was due, so that one that the client sent late is no faster. The
exit status is 1 if a status is not the right one, 95 % take longer than the bound, or memory grows.
"""

import asyncio
import itertools
import json
import os
import random
import re
import secrets
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, NamedTuple

import numpy as np
import typer

from benchmarks.fleet.drives import blocks_of, made, places_of
from benchmarks.fleet.http_client import Connection, chunked_of, request_of
from fusionslam.base.arrays import Floats32
from fusionslam.fleet.config import FleetConfig, FleetSettings
from fusionslam.fleet.folder import FleetFolder
from fusionslam.pipelines.describe import PipelineConfig

DESCRIPTOR = "cm2dp"
"""Its vectors have 576 numbers, as the made ones."""
BOUND_S = 0.1
_SHARE_WRONG = 0.15
"""Of requests."""
_MOST_GROWTH = 0.1
"""Of memory, from the end of the first quarter."""
_QUERIES = 512
_LIMIT_MB = 1

app = typer.Typer(add_completion=False, rich_markup_mode=None, pretty_exceptions_enable=False)


class Kind(NamedTuple):
    """A kind of requests, and the status that is right."""

    name: str
    status: int
    requests: Sequence[bytes]
    is_whole: bool = True


@dataclass
class Tally:
    """What came of the requests."""

    cpu_s: float = 0.0
    statuses: Counter[tuple[str, int]] = field(default_factory=Counter)
    seconds: list[float] = field(default_factory=list)
    wrong: list[str] = field(default_factory=list)


@app.command()
def main(
    places: Annotated[int, typer.Option(help="Number of places.")] = 100_000,
    clients: Annotated[int, typer.Option(help="Number of clients.")] = 64,
    seconds: Annotated[float, typer.Option(help="How long they ask.")] = 60.0,
    rate: Annotated[float, typer.Option(help="Requests a second of each; 0 is no pause.")] = 1.0,
    folder: Annotated[
        Path | None, typer.Option(help="Folder of places to make, or to use again.")
    ] = None,
) -> None:
    """Start the service, ask, and print what came of it."""
    with tempfile.TemporaryDirectory() as temporary:
        home = folder or Path(temporary) / "places"
        make_places(home, places)
        keys = Path(temporary) / "keys"
        key = secrets.token_hex(16)
        keys.write_text(f"load {key}\n")
        with serving(home, keys) as (process, port):
            kinds = kinds_of(key)
            memory: list[float] = []
            tally = asyncio.run(_ask(port, kinds, clients, seconds, rate, process.pid, memory))
    problems = [*report(tally, kinds, memory, seconds), *tally.wrong[:5]]
    for problem in problems:
        print(f"WRONG: {problem}")
    if problems:
        sys.exit(1)


def make_places(folder: Path, count: int) -> None:
    """Make a folder of places with an index, unless it is there."""
    if folder.exists():
        return
    settings = FleetSettings.of((DESCRIPTOR,), PipelineConfig(), FleetConfig(clouds=False))
    folder.mkdir(parents=True)
    settings.save(folder)
    with FleetFolder(folder, settings).database(read_only=False) as database:
        for number, vectors in blocks_of(made(), count):
            database.add(places_of(number, vectors, len(vectors)))
        database.build_index()
        database.compact()
        print(database.index)


def some_vectors(count: int) -> Floats32:
    """Vectors of places that were made as those of ``make_places``."""
    return next(iter(blocks_of(made(1), count)))[1]


def kinds_of(key: str) -> list[Kind]:
    """Return kinds of requests: a good one first, then wrong ones."""
    vectors = some_vectors(_QUERIES)
    length = vectors.shape[1]
    query = "/v1/query?k=10"

    def ask(body: bytes) -> bytes:
        return request_of("POST", query, body, key=key, kind="application/json")

    good = [ask(_json(row)) for row in vectors]
    binary = f"{query}&format=vectors"
    good += [request_of("POST", binary, _npy(row), key=key) for row in vectors]
    nan = _json(vectors[0]).replace(b"[", b"[NaN,", 1)
    long = _LIMIT_MB * 2_000_000
    cloud = "/v1/describe?format=ply"
    return [
        Kind("query", 200, good),
        Kind("no JSON", 422, [ask(b"{" * 99)]),
        Kind("another length", 422, [ask(_json(vectors[0, 1:]))]),
        Kind("NaN", 422, [ask(nan)]),
        Kind("no numbers", 422, [ask(b'{"vector": ["a"]}')]),
        Kind("no cloud", 422, [request_of("POST", cloud, secrets.token_bytes(9999), key=key)]),
        Kind("k too large", 422, [request_of("POST", "/v1/query?k=9999", b"x", key=key)]),
        Kind("unknown format", 415, [request_of("POST", "/v1/describe", b"x", key=key)]),
        Kind("unknown site", 404, [request_of("GET", "/v1/sites/nowhere", key=key)]),
        Kind("no such page", 404, [request_of("GET", "/admin.php", key=key)]),
        Kind("no HTTP", 400, [secrets.token_hex(99).encode() + b"\r\n\r\n"]),
        Kind("no key", 401, [request_of("POST", query, _json(vectors[0]))]),
        Kind("wrong key", 401, [request_of("POST", query, b"x", key=secrets.token_hex(16))]),
        Kind("too long", 413, [request_of("POST", cloud, b"x", key=key, stated=long)], False),
        Kind("too long, chunked", 413, [chunked_of(cloud, b"x" * 100_000, 20, key)]),
        Kind(
            "too many vectors",
            413,
            [request_of("POST", binary, _npy(np.zeros((257, length), np.float32)), key=key)],
        ),
    ]


def _json(vector: Floats32) -> bytes:
    return json.dumps({"vector": vector.tolist()}).encode()


def _npy(array: Floats32) -> bytes:
    with tempfile.SpooledTemporaryFile(1 << 24) as file:
        np.save(file, array)
        file.seek(0)
        return file.read()


@contextmanager
def serving(
    folder: Path, keys: Path, **more: object
) -> Iterator[tuple["subprocess.Popen[str]", int]]:
    """Yield the process of the service, with more settings, and its port."""
    words = ["serve", str(folder), "--port", "0", "--api-keys", str(keys)]
    limits = {"requests_per_minute": 0, "max_request_mb": _LIMIT_MB} | more
    settings = [f"--set=service.{name}={value}" for name, value in limits.items()]
    command = [sys.executable, "-m", "fusionslam", *words, *settings]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        found = re.match(r"http://127\.0\.0\.1:(\d+)", process.stdout.readline())
        assert found, "the service did not start"
        yield process, int(found[1])
        process.send_signal(signal.SIGTERM)
        assert process.wait(30) == 0
    finally:
        process.kill()


async def _ask(
    port: int,
    kinds: Sequence[Kind],
    clients: int,
    seconds: float,
    rate: float,
    pid: int,
    memory: list[float],
) -> Tally:
    """Let all clients ask, and note the memory of the server each second."""
    tally = Tally()
    for warm_up in (True, False):
        tally = Tally()
        end = time.perf_counter() + (3.0 if warm_up else seconds)
        work = [_client(port, kinds, number, end, rate, tally) for number in range(clients)]
        watch = asyncio.create_task(_watch(pid, [] if warm_up else memory))
        before = _cpu_seconds(pid)
        await asyncio.gather(*work)
        tally.cpu_s = _cpu_seconds(pid) - before
        watch.cancel()
    return tally


async def _client(
    port: int, kinds: Sequence[Kind], number: int, end: float, rate: float, tally: Tally
) -> None:
    """Send requests until the end, each when it is due."""
    choice = random.Random(number)
    due = time.perf_counter() + choice.random() / (rate or 1e9)
    async with Connection("127.0.0.1", port) as connection:
        while due < end:
            await asyncio.sleep(max(0.0, due - time.perf_counter()))
            kind = choice.choice(kinds[1:]) if choice.random() < _SHARE_WRONG else kinds[0]
            request = choice.choice(kind.requests)
            status, body = await connection.send(request, is_whole=kind.is_whole)
            now = time.perf_counter()
            tally.statuses[kind.name, status] += 1
            if status != kind.status:
                tally.wrong.append(f"{kind.name}: {status}, {body[:200]!r}")
            if kind is kinds[0]:
                tally.seconds.append(now - due)
            due = due + choice.uniform(0.5, 1.5) / rate if rate else now


def _cpu_seconds(pid: int) -> float:
    """Time that a process has computed, on all cores."""
    fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


async def _watch(pid: int, memory: list[float]) -> None:
    """Note the resident memory of a process, MiB, each second."""
    for _ in itertools.count():
        text = Path(f"/proc/{pid}/status").read_text()
        memory.append(int(text.split("VmRSS:")[1].split()[0]) / 1024)
        await asyncio.sleep(1)


def report(
    tally: Tally, kinds: Sequence[Kind], memory: Sequence[float], seconds: float
) -> list[str]:
    """Print figures; return what is not as it should be."""
    print("| request | status | answers |\n|---|---|--:|")
    for (name, status), count in sorted(tally.statuses.items()):
        print(f"| {name} | {status or 'closed'} | {count} |")
    p50, p95, p99, most = np.percentile(1e3 * np.array(tally.seconds), [50, 95, 99, 100])
    total = sum(tally.statuses.values())
    print(
        f"\n{total / seconds:.0f} requests a second, {len(tally.seconds) / seconds:.0f} queries; "
        f"the service computed {1e3 * tally.cpu_s / total:.1f} ms for each"
    )
    print(f"queries: p50 {p50:.1f} ms, p95 {p95:.1f} ms, p99 {p99:.1f} ms, longest {most:.1f} ms")
    settled = memory[len(memory) // 4]
    print(
        f"memory of the service: {memory[0]:.0f} MiB at the start, {settled:.0f} after a quarter, "
        f"{memory[-1]:.0f} at the end, {max(memory):.0f} at most"
    )
    expected = {kind.name: kind.status for kind in kinds}
    problems = [
        f"{count} x {name}: status {status}, expected {expected[name]}"
        for (name, status), count in tally.statuses.items()
        if status != expected[name]
    ]
    problems += [f"{name}: not sent" for name in expected.keys() - {n for n, _ in tally.statuses}]
    if p95 > 1e3 * BOUND_S:
        problems.append(f"p95 is {p95:.1f} ms, expected at most {1e3 * BOUND_S:g}")
    if memory[-1] > (1 + _MOST_GROWTH) * settled:
        problems.append(f"memory grew from {settled:.0f} to {memory[-1]:.0f} MiB")
    return problems


if __name__ == "__main__":
    app()
