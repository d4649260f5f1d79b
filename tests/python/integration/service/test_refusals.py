# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The service: how it refuses requests that it cannot answer."""

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fleet_service import LENGTH, as_npy, as_npz, scan_at, serving, vectors_of
from fusionslam.datasets import write_cloud
from fusionslam.sensors.frame import Cloud
from rows import rows

ZEROS = [0.0] * LENGTH
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
def test_a_damaged_header_is_no_error_of_the_service(
    client: Any, count: int, tmp_path: Path
) -> None:
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
    "body, code",
    [
        (b"{", "not-json"),
        (b"[1, 2]", "not-vectors"),
        (b"{}", "not-vectors"),
        ({"vector": ZEROS, "k": 3}, "not-vectors"),
        ({"vector": ZEROS[1:]}, "shape"),
        ({"vectors": [ZEROS, ZEROS[1:]]}, "shape"),
        ({"vectors": []}, "shape"),
        ({"vectors": [[[1.0]]]}, "shape"),
        ({"vector": "text"}, "not-numbers"),
        ({"vector": ["1"] * LENGTH}, "not-numbers"),
        ({"vector": [None] * LENGTH}, "not-numbers"),
        ({"vector": {"a": 1}}, "not-numbers"),
        ({"vector": [True] * LENGTH}, "not-numbers"),
        ({"vector": [10**400] * LENGTH}, "not-numbers"),
        ({"vector": [float("nan"), *ZEROS[1:]]}, "not-finite"),
        ({"vector": [1e300, *ZEROS[1:]]}, "not-finite"),
        (b'{"vector": ' + b"[" * 100_000, "not-json"),
        (b"\xff\xfe", "not-json"),
    ],
)
def test_vectors_that_cannot_be_compared_are_named(client: Any, body: Any, code: str) -> None:
    head = {"Content-Type": "application/json"}
    body = body if isinstance(body, bytes) else json.dumps(body).encode()
    assert refusal(client.post("/v1/query", content=body, headers=head)) == (422, code)


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
    answer = client.post(f"/v1/query?{parameters}", json={"vector": ZEROS})
    status, code = refusal(answer)
    assert status == 422 and code in ("parameter", "unknown-parameter")
    assert answer.json()["fields"][0] == parameters.partition("=")[0]


@rows(
    "method, path",
    [
        *(("GET", "places"), ("GET", "sites/depot"), ("GET", "sites/nowhere")),
        *(("POST", "describe?format=bin"), ("POST", "locate?format=bin"), ("POST", "query?k=3")),
    ],
)
def test_unknown_parameters_are_refused_everywhere(client: Any, method: str, path: str) -> None:
    path = f"/v1/{path}{'&' if '?' in path else '?'}sight=depot"
    answer = client.request(method, path, content=BIN.tobytes())
    assert refusal(answer) == (422, "unknown-parameter")
    assert answer.json()["fields"] == ["sight"]


def test_a_site_that_is_not_there_is_named(client: Any) -> None:
    answer = client.get("/v1/sites/nowhere")
    assert refusal(answer) == (404, "unknown-site")
    assert answer.json()["fields"] == ["nowhere"]


@rows(
    "method, path, expected",
    [
        ("GET", "/v2/query", (404, "no-such-page")),
        ("GET", "/page/secret", (404, "no-such-page")),
        ("GET", "/page/..%2fplaces.py", (404, "no-such-page")),
        ("GET", "/v1/query", (405, "wrong-method")),
        ("DELETE", "/v1/places", (405, "wrong-method")),
    ],
)
def test_pages_that_are_not_there(
    client: Any, method: str, path: str, expected: tuple[int, str]
) -> None:
    assert refusal(client.request(method, path)) == expected


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
        head = {"Content-Type": "application/json"}
        assert refusal(client.post("/v1/query", content=long, headers=head))[0] == 413


def test_too_many_points_vectors_or_candidates_are_refused(twenty: Path) -> None:
    with serving(twenty, max_points=8, max_vectors=2, max_k=3) as client:
        answer = client.post("/v1/describe?format=bin", content=BIN.tobytes())
        assert refusal(answer) == (413, "too-many-points")
        answer = client.post("/v1/query", json={"vectors": [ZEROS] * 3})
        assert refusal(answer) == (413, "too-many-vectors")
        answer = client.post("/v1/query?k=4", json={"vector": ZEROS})
        assert refusal(answer) == (422, "parameter")


def test_a_cloud_that_unpacks_to_much_more_is_refused_unpacked(twenty: Path) -> None:
    head = b"VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 300000000\n"
    head += b"HEIGHT 1\nPOINTS 300000000\nDATA binary_compressed\n"
    with serving(twenty) as client:
        answer = client.post(
            "/v1/describe?format=pcd", content=head + struct.pack("<2I", 20, 3_600_000_000)
        )
    assert refusal(answer) == (413, "too-long")


def test_nothing_is_proven_without_stored_clouds(twenty: Path) -> None:
    with serving(twenty) as client:
        answer = client.post("/v1/locate?format=npy", content=as_npy(scan_at("yard", 0)))
    assert refusal(answer) == (501, "no-clouds")


def test_an_error_of_the_service_shows_no_traceback(
    twenty: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from fusionslam.service.places import ServedPlaces

    monkeypatch.setattr(ServedPlaces, "query", lambda *_: 1 / 0)
    with serving(twenty) as client:
        answer = client.post("/v1/query", json={"vector": vectors_of(1, 1)[0].tolist()})
    assert refusal(answer) == (500, "internal")
