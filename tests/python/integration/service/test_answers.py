# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The service: what it answers, to many at once, while places change, and on joint maps."""

import asyncio
import logging
import shutil
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np
import pytest

from artefacts import copy_artefact
from fleet_service import (
    FRAMES,
    LENGTH,
    add_places,
    as_npy,
    make_folder,
    map_pose_at,
    pose_at,
    scan_at,
    serving,
    vectors_of,
    write_joint_map,
)
from fusionslam.datasets import write_cloud
from fusionslam.descriptors import describe
from fusionslam.errors import DataError, FusionSlamError
from fusionslam.fleet.folder import FleetFolder
from fusionslam.fleet.place_database import PlaceDatabase
from fusionslam.fleet.places import PlaceFilter
from fusionslam.mapping import PlaceMap
from fusionslam.sensors.frame import Cloud
from fusionslam.service.batches import QueryBatches
from fusionslam.service.workers import Workers
from rows import rows


@pytest.fixture
def scan(tmp_path: Path) -> Cloud:
    return Cloud(scan_at("yard", 1.3))


def test_clouds_are_described_as_the_library_does(client: Any, scan: Cloud, tmp_path: Path) -> None:
    np.save(tmp_path / "scan.npy", scan.points)
    for form in ("ply", "pcd", "bin"):
        write_cloud(tmp_path / f"scan.{form}", scan)
    expected, whole = describe(scan, "m2dp:robust"), as_npy(scan.points)
    holes = np.concatenate([scan.points, np.full((50, 3), np.nan, np.float32)])
    head = {"Content-Type": "application/x-npy"}
    asked = {
        path: {"params": {"format": path.suffix[1:]}, "content": path.read_bytes()}
        for path in tmp_path.iterdir()
    }
    asked["nan is left out"] = {"params": {"format": "npy"}, "content": as_npy(holes)}
    asked["named by its type"] = {"headers": head, "content": whole}
    for name, request in asked.items():
        answer = client.post("/v1/describe", **request)
        assert answer.status_code == 200, name
        found = answer.json()
        assert (found["descriptor"], found["length"]) == ("m2dp:robust", LENGTH)
        assert found["points"] == len(holes if name == "nan is left out" else scan)
        assert np.array_equal(np.float32(found["vector"]), expected), name


def test_a_cloud_finds_places_of_its_site(client: Any, scan: Cloud) -> None:
    answer = client.post("/v1/query?format=npy&k=3", content=as_npy(scan.points)).json()
    (found,) = answer["results"]
    assert [each["site"] for each in found] == ["yard"] * 3
    distances = [each["distance"] for each in found]
    assert distances == sorted(distances)
    assert found[0]["pose"] == pose_at(found[0]["frame"]).tolist()


def test_vectors_are_searched_one_by_one_or_together(small: Any) -> None:
    vectors = vectors_of(sum(b"monday"), 20)
    one = small.post("/v1/query", json={"vector": vectors[7].tolist()})
    some = small.post("/v1/query", json={"vectors": vectors[3:6].tolist()})
    binary = small.post("/v1/query?format=vectors", content=as_npy(vectors[3:6]))
    assert [found[0]["frame"] for found in one.json()["results"]] == [7]
    assert [found[0]["frame"] for found in some.json()["results"]] == [3, 4, 5]
    assert binary.json() == some.json()


def test_many_vectors_are_searched_part_by_part(small: Any) -> None:
    vectors = vectors_of(sum(b"monday"), 20)
    answer = small.post("/v1/query?k=1", json={"vectors": vectors.tolist() * 5})
    assert [found[0]["frame"] for found in answer.json()["results"]] == [*range(20)] * 5


def test_only_places_that_are_meant_are_found(made: Path) -> None:
    add_places(made, "tuesday", 10, robot="blue", site="dock")
    vector = vectors_of(1, 1)[0].tolist()
    counts = {
        "site=depot": 20,
        "site=yard": 0,
        "robot=blue": 10,
        "region=north&robot=red": 20,
        "session=tuesday": 10,
        "since_ns=5000000000&until_ns=7000000000": 4,
        "site=it's": 0,
    }
    with serving(made) as client:
        for where, count in counts.items():
            answer = client.post(f"/v1/query?k=50&{where}", json={"vector": vector})
            assert len(answer.json()["results"][0]) == count, where


def test_a_cloud_is_located_where_it_was_taken(client: Any, scan: Cloud) -> None:
    answer = client.post("/v1/locate?format=npy&k=4", content=as_npy(scan.points))
    assert answer.status_code == 200
    found = answer.json()
    assert found["place"]["site"] == "yard" and found["reason"] is None
    assert found["probability"] > 0.9
    pose = np.array(found["site_from_robot"])
    assert np.allclose(pose, pose_at(1.3), atol=0.1)


def test_a_cloud_of_elsewhere_is_not_proven(client: Any, scan: Cloud) -> None:
    answer = client.post("/v1/locate?format=npy&site=depot", content=as_npy(scan.points)).json()
    assert answer["candidates"] and answer["place"] is None and answer["site_from_robot"] is None
    assert answer["reason"]


def test_places_are_counted(client: Any) -> None:
    counts = client.get("/v1/places").json()
    assert counts["places"] == 2 * FRAMES and counts["proves"]
    assert counts["sites"] == {"depot": FRAMES, "yard": FRAMES}
    assert counts["robots"] == {"robot-1": 2 * FRAMES}
    assert (counts["descriptor"], counts["length"]) == ("m2dp:robust", LENGTH)


def test_positions_of_a_site_are_listed_by_session(made: Path) -> None:
    add_places(made, "tuesday", 10, site="depot")
    with serving(made, max_positions=10) as client:
        site = client.get("/v1/sites/depot").json()
        whole = client.get("/v1/places").json()
    assert site["places"] == 30 and site["every"] == 3
    monday, tuesday = sorted(site["sessions"], key=lambda each: -each["places"])
    assert monday["places"] == 20 and monday["frames"] == [3, 6, 9, 12, 15, 18]  # 0 has no pose
    assert monday["positions"][0] == pose_at(3)[:3, 3].tolist()
    assert tuesday["session"] == "tuesday" and not whole["proves"]


def test_a_site_may_have_any_name(made: Path) -> None:
    names = ["", "a/b", "zwölf <i>", "it's"]
    for number, site in enumerate(names):
        add_places(made, f"odd{number}", 5, site=site)
    with serving(made) as client:
        for site in names:
            answer = client.get(f"/v1/sites/{quote(site, safe='')}").json()
            assert (answer["site"], answer["places"]) == (site, 5)
            assert client.get(f"/sites/{quote(site, safe='')}").status_code == 200


def test_health_and_metrics_tell_what_the_service_does(twenty: Path) -> None:
    with serving(twenty) as client:
        assert client.get("/health").json() == {"status": "ready", "places": 20}
        client.get("/v1/sites/nowhere")
        client.get("/no/such/page")
        lines = client.get("/metrics").text.splitlines()
    values = dict(line.rsplit(" ", 1) for line in lines if not line.startswith("#"))
    assert float(values["fusionslam_places"]) == 20
    assert float(values["process_resident_memory_bytes"]) > 1e6
    counted = 'fusionslam_requests_total{method="GET",route="%s",status="%s"}'
    assert values[counted % ("/v1/sites/{site:path}", 404)] == "1.0"
    assert values[counted % ("other", 404)] == "1.0"
    assert values['fusionslam_request_seconds_count{route="/health"}'] == "1.0"


def test_the_pages_need_nothing_from_elsewhere(client: Any) -> None:
    for path in ("/", "/docs", "/page/page.js", "/page/map.js", "/page/page.css"):
        answer = client.get(path)
        assert answer.status_code == 200
        addresses = answer.text.replace("http://www.w3.org/2000/svg", "")
        assert "http://" not in addresses and "https://" not in addresses
    assert client.get("/static-offline-docs/swagger-ui-bundle.js").status_code == 200


def test_the_interface_lists_every_route_with_its_refusals(client: Any) -> None:
    listed = client.get("/openapi.json").json()["paths"]
    assert set(listed) == {
        *("/v1/describe", "/v1/query", "/v1/locate", "/v1/places", "/v1/sites/{site}"),
        *("/health", "/metrics"),
    }
    refusals = listed["/v1/query"]["post"]["responses"]
    assert {"200", "401", "408", "413", "415", "422", "429", "503"} <= set(refusals)
    assert "requestBody" in listed["/v1/locate"]["post"]


@pytest.mark.slow
def test_queries_at_once_get_their_own_answers(made: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    sizes: list[int] = []
    query = PlaceDatabase.query

    def note(self: PlaceDatabase, vectors: Any, *rest: Any) -> Any:
        while not sizes and client.app.state.shared.waiting.taken < 10:
            time.sleep(0.001)  # until others wait for the first one
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


def test_an_error_of_all_is_that_of_each_query(made: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    body = {"vector": [0.0] * LENGTH}
    with serving(made, workers=1) as client:
        with monkeypatch.context() as patch:
            patch.setattr(PlaceDatabase, "query", lambda *_: 1 / 0)
            with ThreadPoolExecutor(8) as pool:
                answers = list(pool.map(lambda _: client.post("/v1/query", json=body), range(8)))
        assert {answer.status_code for answer in answers} == {500}
        assert client.post("/v1/query", json=body).status_code == 200
        assert client.app.state.shared.waiting.taken == 0


def test_of_a_batch_that_fails_only_the_culprits_fail() -> None:
    sizes: list[int] = []

    class Places:
        def query(self, vectors: Any, k: int, where: PlaceFilter) -> list[list[Any]]:
            sizes.append(len(vectors))
            if (vectors == 7).any():
                raise DataError("seven", code="damaged")
            return [[float(vector[0])] * k for vector in vectors]

    async def ask() -> list[Any]:
        places: Any = Places()
        workers = Workers(1)
        batches = QueryBatches(places, workers)
        asked = [
            batches.find(np.full((1, 2), number % 10, np.float32), 1, PlaceFilter())
            for number in range(20)
        ]
        found = await asyncio.gather(*asked, return_exceptions=True)
        workers.close()
        return found

    found = asyncio.run(ask())
    assert [number for number in range(20) if isinstance(found[number], DataError)] == [7, 17]
    assert [each for each in found if not isinstance(each, DataError)] == [
        [[number % 10]] for number in range(20) if number % 10 != 7
    ]
    assert max(sizes) > 2


def nearest(client: Any, vector: Any) -> dict[str, Any]:
    answer = client.post("/v1/query?k=1", json={"vector": vector.tolist()})
    assert answer.status_code == 200, answer.text
    found: dict[str, Any] = answer.json()["results"][0][0]
    return found


def test_places_are_found_once_they_are_added_until_they_are_deleted(made: Path) -> None:
    with serving(made) as client:
        vectors = add_places(made, "tuesday", robot="blue", site="dock")
        found = nearest(client, vectors[11])
        assert (found["session"], found["frame"], found["robot"]) == ("tuesday", 11, "blue")
        assert client.get("/v1/places").json()["places"] == 40
        assert client.get("/health").json()["places"] == 40
        with FleetFolder.open(made).database(read_only=False) as database:
            database.delete(PlaceFilter(robot="blue"))
        assert nearest(client, vectors[11])["robot"] == "red"
        assert client.get("/v1/sites/dock").status_code == 404


def test_a_folder_that_is_gone_is_said_to_be_until_it_is_back(made: Path) -> None:
    aside, query = made.parent / "aside", {"json": {"vector": [0.0] * LENGTH}}
    with serving(made) as client:
        for gone in (".", "database", "fleet.json"):
            (made / gone).rename(aside)
            for path in ("/v1/places", "/v1/sites/depot"):
                answer = client.get(path)
                assert (answer.status_code, answer.json()["code"]) == (503, "places")
                assert str(made) not in answer.text
            answer = client.post("/v1/query", **query)
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
        answer = client.post("/v1/query", json={"vector": [0.0] * LENGTH})
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


MONDAY = {frame: 0 for frame in range(0, 20, 2)}


@pytest.fixture
def joined(made: Path) -> Path:
    """Places of three sessions, of which the map has two, and of those one in its first part."""
    pytest.importorskip("gtsam", reason="maps are an extra")
    for session in ("tuesday", "wednesday"):
        add_places(made, session, 6, site="depot")
    write_joint_map(made, "depot", {"monday": MONDAY, "tuesday": {0: 10}, "forgotten": {0: 0}})
    return made


def map_of(client: Any) -> Any:
    answer = client.get("/v1/sites/depot")
    assert answer.status_code == 200, answer.text
    return answer.json()["map"]


def test_a_site_shows_its_joint_map_beside_its_places(joined: Path) -> None:
    with serving(joined) as client:
        site = client.get("/v1/sites/depot").json()
    (monday,) = site["map"]["sessions"]
    assert (site["map"]["keyframes"], site["map"]["every"]) == (10, 1)
    assert (monday["session"], monday["keyframes"]) == ("monday", 10)
    assert monday["frames"] == [*MONDAY]
    assert np.allclose(monday["positions"], [map_pose_at(frame)[:3, 3] for frame in MONDAY])
    assert [each["session"] for each in site["sessions"]] == ["monday", "tuesday", "wednesday"]
    assert site["sessions"][0]["positions"][0] == pose_at(1)[:3, 3].tolist()


def test_of_many_keyframes_every_nth_is_listed(joined: Path) -> None:
    with serving(joined, max_positions=4) as client:
        found = map_of(client)
    assert (found["keyframes"], found["every"]) == (10, 3)
    assert found["sessions"][0]["frames"] == [0, 6, 12, 18]


def test_a_joint_map_is_read_again_if_it_changed(
    joined: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened: list[Path] = []
    open_map = PlaceMap.open

    def note(path: Path, *args: Any, **options: Any) -> PlaceMap:
        opened.append(path)
        return open_map(path, *args, **options)

    monkeypatch.setattr(PlaceMap, "open", note)
    with serving(joined) as client:
        assert map_of(client) == map_of(client)
        assert len(opened) == 1
        path = opened[0]
        path.unlink()
        assert map_of(client) is None
        write_joint_map(joined, "depot", {"wednesday": {3: 0}})
        assert [each["session"] for each in map_of(client)["sessions"]] == ["wednesday"]
        with open_map(path) as writer:  # what it changes is in the log of SQLite at first
            writer.forget("wednesday")
            assert map_of(client)["sessions"] == []
    assert len(opened) == 3


@rows("content", [b"", b"no map", None])
def test_a_map_that_cannot_be_read_is_logged_once_and_none(
    joined: Path, tmp_path: Path, content: bytes | None, caplog: pytest.LogCaptureFixture
) -> None:
    folder = shutil.copytree(joined, tmp_path / "places")
    (path,) = (folder / "maps").glob("*.fsmap")
    path.write_bytes(path.read_bytes()[:100_000] if content is None else content)
    with serving(folder) as client, caplog.at_level(logging.WARNING):
        assert map_of(client) is None and map_of(client) is None
    (record,) = [each for each in caplog.records if each.name.endswith("joint_maps")]
    assert str(path) in record.getMessage()


def test_without_the_extra_of_maps_there_are_none_and_the_log_says_so_once(
    joined: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def lack(*_: Any, **__: Any) -> Any:
        raise FusionSlamError("no GTSAM", code="missing-extra", fields=("map",))

    add_places(joined, "thursday", 3, site="attic")
    shutil.copytree(joined / "maps", joined / "more")
    (joined / "more" / "depot.fsmap").rename(joined / "maps" / "attic.fsmap")
    monkeypatch.setattr(PlaceMap, "open", lack)
    with serving(joined) as client, caplog.at_level(logging.WARNING):
        assert map_of(client) is None
        assert client.get("/v1/sites/attic").json()["map"] is None
    assert len([each for each in caplog.records if each.name.endswith("joint_maps")]) == 1


def test_a_scan_is_located_in_the_joint_map(fleet: Path, tmp_path: Path) -> None:
    pytest.importorskip("gtsam", reason="maps are an extra")
    folder = copy_artefact(fleet, tmp_path / "places")
    path = write_joint_map(folder, "yard", {"yard/robot-1/yard-monday": {0: 0, 3: 0}})
    scan = as_npy(scan_at("yard", 1.3))
    with serving(folder) as client:
        found = client.post("/v1/locate?format=npy&k=4", content=scan).json()
        path.unlink()
        without = client.post("/v1/locate?format=npy&k=4", content=scan).json()
        nowhere = client.post("/v1/locate?format=npy&site=depot", content=scan).json()
    assert np.allclose(found["site_from_robot"], pose_at(1.3), atol=0.1)
    assert np.allclose(found["map_from_robot"], map_pose_at(1.3), atol=0.1)
    near = {each["frame"]: each for each in found["candidates"] if "monday" in each["session"]}
    assert np.allclose(near[1]["map_pose"], map_pose_at(1.0), atol=1e-6)
    assert found["place"] in found["candidates"]
    assert without["map_from_robot"] is without["place"]["map_pose"] is None
    assert without["site_from_robot"] == found["site_from_robot"]
    assert nowhere["map_from_robot"] is None


def test_a_place_without_its_cloud_proves_nothing(fleet: Path, tmp_path: Path) -> None:
    folder = copy_artefact(fleet, tmp_path / "places")
    add_places(folder, "tuesday", 3, site="yard")  # of a chunk that is not there
    with serving(folder) as client:
        scan = as_npy(scan_at("yard", 1.3))
        found = client.post("/v1/locate?format=npy&site=yard", content=scan).json()
    assert len(found["candidates"]) == 7 and found["place"]["session"].endswith("yard-monday")
