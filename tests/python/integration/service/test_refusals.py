# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The service: what it refuses, who may use it, and how much."""

import asyncio
import hashlib
import json
import os
import struct
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from error_codes import has_code
from fleet_service import KEY, LENGTH, as_npy, as_npz, scan_at, serving, vectors_of
from fusionslam.datasets import write_cloud
from fusionslam.errors import ConfigError
from fusionslam.sensors.frame import Cloud
from fusionslam.service.config import ServiceConfig
from fusionslam.service.keys import VARIABLE, ApiKeys
from fusionslam.service.listening import check_exposure
from fusionslam.service.places import PlaceCount, ServedPlaces
from fusionslam.service.workers import Workers
from rows import grouped, rows

ZEROS = [0.0] * LENGTH
VECTOR = {"vector": ZEROS}
JSON = {"Content-Type": "application/json"}
BIN = np.ones((9, 4), np.float32)


def refusal(answer: Any) -> tuple[int, str]:
    """Status and code; every refusal has the same form and no traceback."""
    content = answer.json()
    assert set(content) == {"code", "message", "fields"}
    assert "Traceback" not in answer.text and "/tmp" not in answer.text
    return answer.status_code, content["code"]


@rows(
    "format, body, expected",
    [
        ("bin", b"", (422, "no-body")),
        ("ply", b"", (422, "no-body")),
        ("bin", b"123", (422, "truncated")),
        ("ply", b"no cloud", (422, "bad-header")),
        ("pcd", b"no cloud", (422, "bad-header")),
        ("npy", b"no cloud", (422, "not-npy")),
        ("npy", as_npy(np.zeros((3, 2))), (422, "shape")),
        ("npy", as_npy(np.zeros((0, 3))), (422, "no-points")),
        ("npy", as_npy(np.array([["a", "b", "c"]])), (422, "not-numbers")),
        ("npy", as_npy(np.zeros((3, 3), complex)), (422, "not-numbers")),
        ("npy", as_npy(np.full((9, 3), np.nan)), (422, "data")),
        ("npy", as_npy(np.ones((9, 3))), (422, "data")),
        ("npy", as_npy(np.full((9, 3), 1e30)), (422, "far-points")),
        ("npy", as_npz(np.ones((9, 3))), (422, "npz")),
        ("npy", as_npy(np.array([{}], object)), (422, "not-npy")),
        ("npy", as_npy(np.zeros((9, 3))).replace(b"), }", b")   "), (422, "not-npy")),
        ("npy", as_npy(np.zeros((9, 3))).replace(b"(9, 3), }", b"(-9, 3),}"), (422, "not-npy")),
        ("tiff", b"x", (415, "format")),
        ("vectors", b"x", (415, "format")),
        (None, b"x", (415, "format")),
    ],
)
def test_a_body_that_is_no_cloud_is_named(
    client: Any, format: str | None, body: bytes, expected: tuple[int, str]
) -> None:
    parameters = {} if format is None else {"format": format}
    for route in ("describe", "locate"):
        answer = client.post(f"/v1/{route}", params=parameters, content=body)
        assert refusal(answer) == expected


def file_of(form: str, points: np.ndarray, folder: Path) -> bytes:
    if form == "npy":
        return as_npy(points)
    write_cloud(folder / f"cloud.{form}", Cloud(points))
    return (folder / f"cloud.{form}").read_bytes()


@pytest.mark.parametrize("count", [4, pytest.param(150, marks=pytest.mark.nightly)])
def test_a_damaged_header_is_no_internal_error(client: Any, count: int, tmp_path: Path) -> None:
    for form in ("ply", "pcd", "npy"):
        whole = file_of(form, scan_at("yard", 0)[:60], tmp_path)
        rng = np.random.default_rng(3)
        for _ in range(count):
            damaged = bytearray(whole)
            for place in rng.integers(0, 250, 3).tolist():
                damaged[place] = rng.integers(0, 256)
            answer = client.post(f"/v1/describe?format={form}", content=bytes(damaged))
            assert answer.status_code == 200 or refusal(answer)[0] in (413, 422), form


@pytest.mark.parametrize("count", [4, pytest.param(25, marks=pytest.mark.nightly)])
def test_a_cloud_cut_anywhere_is_refused_or_read(client: Any, count: int, tmp_path: Path) -> None:
    for form in ("ply", "pcd", "bin", "npy"):
        whole = file_of(form, scan_at("yard", 0)[:400], tmp_path)
        for length in np.linspace(1, len(whole) - 1, count).astype(int).tolist():
            answer = client.post(f"/v1/describe?format={form}", content=whole[:length])
            if not (form == "bin" and length % 16 == 0):
                assert refusal(answer)[0] == 422, form


@rows(
    "code, body",
    grouped(
        {
            "not-json": [b"{", b"\xff\xfe", b'{"vector": ' + b"[" * 100_000],
            "not-vectors": [b"[1, 2]", b"{}", {"vector": ZEROS, "k": 3}],
            "shape": [
                *({"vector": ZEROS[1:]}, {"vectors": [ZEROS, ZEROS[1:]]}),
                *({"vectors": []}, {"vectors": [[[1.0]]]}),
            ],
            "not-numbers": [
                *({"vector": wrong} for wrong in ("text", {"a": 1})),
                *({"vector": [wrong] * LENGTH} for wrong in ("1", None, True, 10**400)),
            ],
            "not-finite": [{"vector": [wrong, *ZEROS[1:]]} for wrong in (float("nan"), 1e300)],
            "too-long": [
                *({"vector": [wrong] * LENGTH} for wrong in (1e38, 1e18, -3e37)),
                {"vectors": [ZEROS, [1e19, *ZEROS[1:]]]},
            ],
        }
    ),
)
def test_vectors_that_cannot_be_compared_are_named(client: Any, code: str, body: Any) -> None:
    body = body if isinstance(body, bytes) else json.dumps(body).encode()
    assert refusal(client.post("/v1/query", content=body, headers=JSON)) == (422, code)


def test_an_array_of_other_vectors_is_refused(client: Any) -> None:
    for array, code in (
        (np.zeros((2, LENGTH + 1)), "shape"),
        (np.full((2, LENGTH), np.inf), "not-finite"),
        (np.zeros((1, 1, LENGTH)), "shape"),
    ):
        answer = client.post("/v1/query?format=vectors", content=as_npy(array))
        assert refusal(answer) == (422, code)


@rows(
    "parameters",
    [
        *("k=0", "k=-1", "k=101", "k=many", "k=1e3", "since_ns=now", "until_ns=1e400"),
        *("since_ns=99999999999999999999", "site=a%00b", f"site={'x' * 501}", "sight=depot"),
    ],
)
def test_parameters_out_of_range_are_named(client: Any, parameters: str) -> None:
    answer = client.post(f"/v1/query?{parameters}", json=VECTOR)
    status, code = refusal(answer)
    assert status == 422 and code in ("parameter", "unknown-parameter")
    assert answer.json()["fields"][0] == parameters.partition("=")[0]


@rows(
    "asked",
    [
        *("GET places", "GET sites/depot", "GET sites/nowhere"),
        *("POST describe?format=bin", "POST locate?format=bin", "POST query?k=3"),
    ],
)
def test_unknown_parameters_are_refused_everywhere(client: Any, asked: str) -> None:
    method, path = asked.split()
    path = f"/v1/{path}{'&' if '?' in path else '?'}sight=depot"
    answer = client.request(method, path, content=BIN.tobytes())
    assert refusal(answer) == (422, "unknown-parameter")
    assert answer.json()["fields"] == ["sight"]


def test_a_site_that_is_not_there_is_named(client: Any) -> None:
    answer = client.get("/v1/sites/nowhere")
    assert refusal(answer) == (404, "unknown-site")
    assert answer.json()["fields"] == ["nowhere"]


@rows(
    "expected, asked",
    grouped(
        {
            (404, "no-such-page"): [
                "GET /v2/query",
                "GET /page/secret",
                "GET /page/..%2fplaces.py",
            ],
            (405, "wrong-method"): ["GET /v1/query", "DELETE /v1/places"],
        }
    ),
)
def test_pages_that_are_not_there(client: Any, expected: tuple[int, str], asked: str) -> None:
    assert refusal(client.request(*asked.split())) == expected


def test_bodies_are_cut_off_at_the_limit_with_and_without_a_stated_length(twenty: Path) -> None:
    parts = [b"x" * 50_000] * 50
    taken = 0

    def stream() -> Any:
        nonlocal taken
        for part in parts:
            taken += 1
            yield part

    with serving(twenty, max_request_mb=0.1) as client:
        for body in (b"".join(parts), stream()):
            answer = client.post("/v1/describe?format=bin", content=body)
            assert refusal(answer) == (413, "too-long")
        lie = {"Content-Length": "1" + "0" * 30}
        answer = client.post("/v1/describe?format=bin", content=BIN.tobytes(), headers=lie)
        assert refusal(answer) == (413, "too-long")
        long = json.dumps({"vectors": [[0.123456789] * LENGTH] * 300})
        assert refusal(client.post("/v1/query", content=long, headers=JSON))[0] == 413


def test_too_many_points_vectors_or_candidates_are_refused(twenty: Path) -> None:
    with serving(twenty, max_points=8, max_vectors=2, max_k=3) as client:
        answer = client.post("/v1/describe?format=bin", content=BIN.tobytes())
        assert refusal(answer) == (413, "too-many-points")
        answer = client.post("/v1/query", json={"vectors": [ZEROS] * 3})
        assert refusal(answer) == (413, "too-many-vectors")
        answer = client.post("/v1/query?k=4", json=VECTOR)
        assert refusal(answer) == (422, "parameter")


def test_a_cloud_that_unpacks_to_much_more_is_refused_unpacked(twenty: Path) -> None:
    head = b"VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 300000000\n"
    head += b"HEIGHT 1\nPOINTS 300000000\nDATA binary_compressed\n"
    with serving(twenty) as client:
        content = head + struct.pack("<2I", 20, 3_600_000_000)
        answer = client.post("/v1/describe?format=pcd", content=content)
    assert refusal(answer) == (413, "too-long")


@rows("path", ["/v1/query", "/v1/places", "/health", "/"])
def test_a_body_of_two_lengths_is_refused(small: Any, path: str) -> None:
    both = {"Content-Length": "5", "Transfer-Encoding": "chunked"}
    method = "POST" if path == "/v1/query" else "GET"
    answer = small.request(method, path, headers=both, content=b"x" * 5)
    assert refusal(answer) == (400, "two-lengths")
    assert answer.headers["Connection"] == "close"


def test_nothing_is_proven_without_stored_clouds(twenty: Path) -> None:
    with serving(twenty) as client:
        answer = client.post("/v1/locate?format=npy", content=as_npy(scan_at("yard", 0)))
    assert refusal(answer) == (501, "no-clouds")


def test_an_internal_error_shows_no_traceback(
    twenty: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ServedPlaces, "query", lambda *_: 1 / 0)
    with serving(twenty) as client:
        answer = client.post("/v1/query", json={"vector": vectors_of(1, 1)[0].tolist()})
    assert refusal(answer) == (500, "internal")


OTHER = "another-key-for-tests-9876543210"


@pytest.fixture
def key_file(tmp_path: Path) -> Path:
    path = tmp_path / "keys.txt"
    digest = hashlib.sha256(OTHER.encode()).hexdigest()
    path.write_text(f"# who may\n\nred {KEY}  # a robot\nblue sha256:{digest}\n")
    return path


def bearer(key: str) -> dict[str, str]:
    return {"Authorization": f"Bearer {key}"}


@pytest.fixture
def locked(twenty: Path, key_file: Path) -> Iterator[Any]:
    """A client of a service with keys."""
    with serving(twenty, ApiKeys.load(key_file)) as client:
        yield client


@rows("key", [KEY, OTHER])
def test_a_key_lets_in_whether_it_is_stored_or_its_digest(locked: Any, key: str) -> None:
    for path in ("/v1/places", "/v1/sites/depot", "/metrics"):
        assert locked.get(path, headers=bearer(key)).status_code == 200
    assert locked.post("/v1/query", json=VECTOR, headers=bearer(key)).status_code == 200


@rows(
    "code, headers",
    grouped(
        {
            "no-key": [{}, bearer(""), {"Authorization": f"Basic {KEY}"}, {"X-Api-Key": KEY}],
            "wrong-key": map(bearer, ["wrong", KEY + "x", "sha256:" + "0" * 64, "\xff\xfe"]),
        }
    ),
)
def test_without_a_right_key_nothing_is_told(
    twenty: Path, key_file: Path, code: str, headers: dict[str, str]
) -> None:
    given = {name: value.encode("latin-1") for name, value in headers.items()}
    gets, posts = ("places", "sites/nowhere"), ("describe?format=x", "query?k=0", "locate")
    asked = [("GET", "/metrics"), *(("GET", f"/v1/{path}") for path in gets)]
    asked += [("POST", f"/v1/{path}") for path in posts]
    with serving(twenty, ApiKeys.load(key_file)) as client:  # guesses are counted
        for method, path in asked:
            answer = client.request(method, path, headers=given, content=b"x" * 10)
            assert (answer.status_code, answer.json()["code"]) == (401, code)
            assert answer.headers["WWW-Authenticate"] == "Bearer"
        assert client.get("/health").status_code == client.get("/").status_code == 200


def test_keys_come_from_the_environment(key_file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(VARIABLE, f"{'e' * 20} {'f' * 20}")
    keys = ApiKeys.load(key_file)
    assert len(keys) == 4
    assert len({keys.find(key) for key in (KEY, OTHER, "e" * 20, "f" * 20)} - {None}) == 4


@rows(
    "text, code",
    [
        ("red short", "short-key"),
        (KEY, "bad-key"),
        (f"red {KEY} more", "bad-key"),
        ("# nothing\n", "config-file"),
        (None, "config-file"),
        (b"\xff\xfe\x00", "config-file"),
    ],
)
def test_a_file_without_keys_is_refused(
    tmp_path: Path, text: str | bytes | None, code: str
) -> None:
    path = tmp_path / "keys.txt"
    if text is not None:
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(ConfigError) as caught:
        ApiKeys.load(path)
    assert caught.value.code == code and KEY not in str(caught.value)


@rows("host", ["0.0.0.0", "::", "192.168.1.5", "example.org"])
def test_other_machines_are_let_in_by_keys_only_unless_that_is_wanted(host: str) -> None:
    config, keys = ServiceConfig(host=host), ApiKeys([b"x" * 32])
    with pytest.raises(ConfigError, check=has_code("no-keys")):
        check_exposure(config, ApiKeys(), without_keys=False)
    check_exposure(config, keys, without_keys=False)
    check_exposure(config, ApiKeys(), without_keys=True)


@rows("host", ["127.0.0.1", "::1", "localhost", "127.8.8.8"])
def test_this_machine_needs_no_keys(host: str) -> None:
    check_exposure(ServiceConfig(host=host), ApiKeys(), without_keys=False)


def test_pages_of_other_names_cannot_use_a_service_without_keys(small: Any, locked: Any) -> None:
    """A name that its owner lets point to 127.0.0.1 would else get around the browser's rules."""
    named = {"Host": "evil.example"}
    odd = ("localhost:x", "evil@localhost", "localhost/x", "[::1", "::1", "", "a b", "localhost:")
    for host in (named["Host"], *odd, "evil.example#localhost", "localhost:80:80"):
        answer = small.get("/v1/places", headers={"Host": host})
        assert refusal(answer) == (421, "wrong-host"), host
    for host in ("[::1]:8766", "localhost", "127.0.0.1:1"):
        assert small.get("/v1/places", headers={"Host": host}).status_code == 200
    assert locked.get("/v1/places", headers=named | bearer(KEY)).status_code == 200


def test_too_many_requests_are_turned_away_with_a_time(
    twenty: Path, key_file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(time, "time", lambda: 1_000_000.0)  # all of them are of one minute
    with serving(twenty, ApiKeys.load(key_file), requests_per_minute=5) as client:
        statuses = [client.get("/v1/places", headers=bearer(KEY)).status_code for _ in range(7)]
        late = client.get("/v1/places", headers=bearer(KEY))
        other = client.get("/v1/places", headers=bearer(OTHER))
        guesses = [client.get("/v1/places", headers=bearer("x")).status_code for _ in range(7)]
        again = client.get("/v1/places", headers=bearer(OTHER))
    assert statuses == [200] * 5 + [429] * 2
    assert late.json()["code"] == "too-many-requests"
    assert 1 <= int(late.headers["Retry-After"]) <= 60
    assert other.status_code == again.status_code == 200
    assert guesses == [401] * 5 + [429] * 2


def test_a_service_with_too_much_to_do_says_so_at_once(twenty: Path) -> None:
    with serving(twenty, max_waiting=1) as client:
        with client.app.state.shared.waiting.place("another"):
            answers = [client.get("/v1/places"), client.post("/v1/query", json=VECTOR)]
            assert client.get("/health").status_code == 200
        assert client.get("/v1/places").status_code == 200
    for answer in answers:
        assert (answer.status_code, answer.json()["code"]) == (503, "busy")
        assert answer.headers["Retry-After"] == "1"


def test_one_client_takes_only_its_share_of_the_places(twenty: Path, key_file: Path) -> None:
    with serving(twenty, ApiKeys.load(key_file), max_waiting=8, max_waiting_of_one=2) as client:
        state = client.app.state.shared
        red = state.keys.find(KEY)
        with ExitStack() as taken:
            for room in (state.waiting, state.waiting, state.bodies):
                taken.enter_context(room.place(red))
            answers = [
                client.post("/v1/query", json=VECTOR, headers=bearer(key)) for key in (KEY, OTHER)
            ]
        again = client.post("/v1/query", json=VECTOR, headers=bearer(KEY))
    assert [each.status_code for each in (*answers, again)] == [503, 200, 200]
    assert refusal(answers[0]) == (503, "busy") and answers[0].json()["fields"] == ["2"]


def test_a_body_that_is_on_its_way_takes_no_place(twenty: Path) -> None:
    taken: list[tuple[int, int]] = []

    def body() -> Iterator[bytes]:
        for part in (b'{"vector": ', json.dumps(ZEROS).encode(), b"}"):
            taken.append((state.waiting.taken, state.bodies.taken))
            yield part

    with serving(twenty, max_bodies_of_one=1) as client:
        state = client.app.state.shared
        assert client.post("/v1/query", content=body(), headers=JSON).status_code == 200
        assert {waiting for waiting, _ in taken} == {0}
        with state.bodies.place("testclient"):
            assert refusal(client.post("/v1/query", json=VECTOR)) == (503, "busy")
            assert client.get("/v1/places").status_code == 200


def test_clients_get_threads_in_turn() -> None:
    order: list[str] = []

    async def ask() -> None:
        workers = Workers(1)
        asked = [f"greedy {number}" for number in range(6)] + ["red 0", "blue 0", "red 1"]
        running = [
            asyncio.create_task(workers.run(partial(order.append, each), each.split()[0]))
            for each in asked
        ]
        await asyncio.sleep(0)  # all of them wait now, but for the first
        running[2].cancel()
        await asyncio.gather(*running, return_exceptions=True)
        assert await workers.run(lambda: 7, "late") == 7
        workers.close()

    asyncio.run(ask())
    assert order == [
        *("greedy 0", "greedy 1", "red 0", "blue 0", "red 1", "greedy 3", "greedy 4", "greedy 5")
    ]


def test_health_answers_while_workers_are_busy(
    twenty: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    begun, let_go = threading.Event(), threading.Event()
    query = ServedPlaces.query

    def wait(*args: Any) -> Any:
        begun.set()
        let_go.wait()
        return query(*args)

    monkeypatch.setattr(ServedPlaces, "query", wait)
    with serving(twenty, workers=1) as client, ThreadPoolExecutor() as pool:
        try:
            busy = pool.submit(client.post, "/v1/query", json=VECTOR)
            begun.wait()
            assert client.get("/health").json() == {"status": "ready", "places": 20}
            assert "fusionslam_requests_waiting 1.0" in client.get("/metrics").text
            assert not busy.done()
        finally:
            let_go.set()
        assert busy.result().status_code == 200


def test_queries_are_answered_while_clouds_are_described(
    twenty: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    begun, let_go = threading.Event(), threading.Event()
    niceness: list[int] = []

    def wait(*args: Any) -> Any:
        niceness.append(os.getpriority(os.PRIO_PROCESS, 0))
        begun.set()
        let_go.wait()
        return np.zeros(LENGTH, np.float32)

    monkeypatch.setattr(ServedPlaces, "describe", wait)
    with serving(twenty, workers=1) as client, ThreadPoolExecutor() as pool:
        try:
            described = "/v1/describe?format=bin"
            busy = [pool.submit(client.post, described, content=BIN.tobytes()) for _ in range(2)]
            begun.wait()
            assert client.post("/v1/query", json=VECTOR).status_code == 200
            assert not any(each.done() for each in busy)
        finally:
            let_go.set()
        assert [each.result().status_code for each in busy] == [200, 200]
    own = os.getpriority(os.PRIO_PROCESS, 0)
    assert niceness == [min(own + 5, 19)] * 2


def test_places_are_counted_once_for_all_who_ask_meanwhile() -> None:
    let_go = threading.Event()

    class Places:
        counted = 0

        def __len__(self) -> int:
            let_go.wait()
            self.counted += 1
            return 7

    places: Any = Places()

    async def ask() -> list[int | None]:
        count = PlaceCount(places)
        asked = [asyncio.create_task(count.get()) for _ in range(20)]
        await asyncio.sleep(0)  # all of them wait now
        asked.pop().cancel()
        let_go.set()
        found = [await each for each in asked]
        count.close()
        return found

    assert asyncio.run(ask()) == [7] * 19
    assert places.counted == 1


def test_a_place_is_free_again_after_every_refusal(twenty: Path) -> None:
    with serving(twenty, max_waiting=1, max_request_mb=0.01) as client:
        for body in (b"", b"xyz", b"x" * 20_000):
            client.post("/v1/describe?format=bin", content=body)
        client.get("/v1/sites/nowhere")
        assert client.app.state.shared.waiting.taken == 0
        assert client.get("/v1/places").status_code == 200
