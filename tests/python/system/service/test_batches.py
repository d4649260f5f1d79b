# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The service: queries that wait together are answered as if each had come alone."""

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

from fleet_service import LENGTH, add_places, serving, vectors_of
from fusionslam.fleet.place_database import PlaceDatabase


def test_queries_at_the_same_time_get_their_own_answers(
    made: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sizes: list[int] = []
    query = PlaceDatabase.query

    def note(self: PlaceDatabase, vectors: Any, *rest: Any) -> Any:
        sizes.append(len(vectors))
        return query(self, vectors, *rest)

    add_places(made, "tuesday", site="dock")
    vectors = vectors_of(sum(b"monday"), 20)
    filters = ("", "&site=dock", "&robot=red&until_ns=4000000000")

    with serving(made, workers=1) as client:

        def ask(number: int) -> list[tuple[str, int]]:
            path = f"/v1/query?k={1 + number % 7}{filters[number % 3]}"
            answer = client.post(path, json={"vector": vectors[number % 20].tolist()})
            assert answer.status_code == 200
            (found,) = answer.json()["results"]
            return [(each["session"], each["frame"]) for each in found]

        alone = [ask(number) for number in range(60)]
        monkeypatch.setattr(PlaceDatabase, "query", note)
        with ThreadPoolExecutor(30) as pool:
            assert list(pool.map(ask, range(60))) == alone
    assert sum(sizes) == 60 and max(sizes) > 1


def test_many_vectors_are_searched_part_by_part(made: Path) -> None:
    vectors = vectors_of(sum(b"monday"), 20)
    with serving(made) as client:
        answer = client.post("/v1/query?k=1", json={"vectors": vectors.tolist() * 5})
    frames = [found[0]["frame"] for found in answer.json()["results"]]
    assert frames == [*range(20)] * 5


def test_an_error_of_a_batch_is_that_of_each_query_and_the_next_is_answered(
    made: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    body = {"vector": [0.0] * LENGTH}
    with serving(made, workers=1) as client:
        with monkeypatch.context() as patch:
            patch.setattr(PlaceDatabase, "query", lambda *_: 1 / 0)
            with ThreadPoolExecutor(8) as pool:
                answers = list(pool.map(lambda _: client.post("/v1/query", json=body), range(8)))
        assert {answer.status_code for answer in answers} == {500}
        assert client.post("/v1/query", json=body).status_code == 200
        assert client.app.state.shared.workers.busy == 0
