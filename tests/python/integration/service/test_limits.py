# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The service: who may use it, and how much."""

import asyncio
import hashlib
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

from error_codes import has_code
from fleet_service import KEY, LENGTH, serving
from fusionslam.errors import ConfigError
from fusionslam.service.config import ServiceConfig
from fusionslam.service.keys import VARIABLE, ApiKeys
from fusionslam.service.listening import check_exposure
from fusionslam.service.place_count import PlaceCount
from fusionslam.service.places import ServedPlaces
from rows import rows

OTHER = "another-key-for-tests-9876543210"
VECTOR = {"vector": [0.0] * LENGTH}


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
    "headers, code",
    [
        ({}, "no-key"),
        ({"Authorization": "Bearer "}, "no-key"),
        ({"Authorization": f"Basic {KEY}"}, "no-key"),
        ({"X-Api-Key": KEY}, "no-key"),
        (bearer("wrong"), "wrong-key"),
        (bearer(KEY + "x"), "wrong-key"),
        (bearer("sha256:" + "0" * 64), "wrong-key"),
        ({"Authorization": "Bearer \xff\xfe"}, "wrong-key"),
    ],
)
def test_without_a_right_key_nothing_is_told(
    twenty: Path, key_file: Path, headers: dict[str, str], code: str
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


def test_keys_come_from_the_environment_too(
    key_file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
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
def test_a_file_without_good_keys_is_refused(
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
    answer = small.get("/v1/places", headers=named)
    assert (answer.status_code, answer.json()["code"]) == (421, "wrong-host")
    assert small.get("/v1/places", headers={"Host": "[::1]:8766"}).status_code == 200
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
        workers: Any = client.app.state.shared.workers
        with workers.place():
            answers = [client.get("/v1/places"), client.post("/v1/query", json=VECTOR)]
            assert client.get("/health").status_code == 200
        assert client.get("/v1/places").status_code == 200
    for answer in answers:
        assert (answer.status_code, answer.json()["code"]) == (503, "busy")
        assert answer.headers["Retry-After"] == "1"


def test_health_and_metrics_answer_while_all_workers_are_busy(
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
        assert client.app.state.shared.workers.busy == 0
        assert client.get("/v1/places").status_code == 200
