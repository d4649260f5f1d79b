# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The service: places that change while they are served."""

import shutil
import time
from pathlib import Path
from typing import Any

import pytest

from fleet_service import add_places, make_folder, serving
from fusionslam.errors import DataError
from fusionslam.fleet.folder import FleetFolder
from fusionslam.fleet.places import PlaceFilter


def nearest(client: Any, vector: Any) -> dict[str, Any]:
    answer = client.post("/v1/query?k=1", json={"vector": vector.tolist()})
    assert answer.status_code == 200, answer.text
    found: dict[str, Any] = answer.json()["results"][0][0]
    return found


def test_places_that_are_added_are_found_within_a_second(made: Path) -> None:
    with serving(made) as client:
        vectors = add_places(made, "tuesday", robot="blue", site="dock")
        begun = time.monotonic()
        found = nearest(client, vectors[11])
        assert time.monotonic() - begun < 1
        assert (found["session"], found["frame"]) == ("tuesday", 11)
        assert client.get("/v1/places").json()["places"] == 40
        assert client.get("/health").json()["places"] == 40


def test_places_of_a_robot_that_is_deleted_are_found_no_more(made: Path) -> None:
    vectors = add_places(made, "tuesday", robot="blue", site="dock")
    with serving(made) as client:
        assert nearest(client, vectors[11])["robot"] == "blue"
        with FleetFolder.open(made).database(read_only=False) as database:
            database.delete(PlaceFilter(robot="blue"))
        assert nearest(client, vectors[11])["robot"] == "red"
        assert client.get("/v1/sites/dock").status_code == 404


@pytest.mark.parametrize("gone", [".", "database", "fleet.json"])
def test_a_folder_that_is_gone_is_said_to_be_until_it_is_back(made: Path, gone: str) -> None:
    with serving(made) as client:
        aside = made.parent / "aside"
        (made / gone).rename(aside)
        for method, path in (("GET", "/v1/places"), ("GET", "/v1/sites/depot")):
            answer = client.request(method, path)
            assert (answer.status_code, answer.json()["code"]) == (503, "places")
            assert str(made) not in answer.text
        answer = client.post("/v1/query", json={"vector": [0.0] * 192})
        assert answer.status_code == 503 and int(answer.headers["Retry-After"]) > 0
        health = client.get("/health")
        assert (health.status_code, health.json()["status"]) == (503, "unavailable")
        assert client.get("/metrics").status_code == 200
        aside.rename(made / gone)
        assert client.get("/health").json() == {"status": "ready", "places": 20}


def test_files_that_are_damaged_are_no_error_of_the_client(made: Path) -> None:
    with serving(made) as client:
        for path in made.rglob("*.lance"):
            if path.is_file():
                path.write_bytes(b"damaged")
        for path in made.rglob("*.manifest"):
            path.unlink()
        answer = client.post("/v1/query", json={"vector": [0.0] * 192})
        assert (answer.status_code, answer.json()["code"]) == (503, "places")


def test_a_folder_that_is_replaced_is_served_instead(made: Path) -> None:
    with serving(made) as client:
        assert client.get("/v1/places").json()["sites"] == {"depot": 20}
        shutil.rmtree(made)
        make_folder(made)
        vectors = add_places(made, "friday", 7, site="attic")
        assert client.get("/v1/places").json()["sites"] == {"attic": 7}
        assert nearest(client, vectors[3])["session"] == "friday"


def test_what_is_no_folder_of_places_is_refused(tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    for name in ("empty", "nowhere"):
        with pytest.raises(DataError), serving(tmp_path / name):
            pass
