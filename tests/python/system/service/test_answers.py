# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The service: what it answers to good requests."""

from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np
import pytest

from fleet_service import (
    FRAMES,
    LENGTH,
    add_places,
    as_npy,
    pose_at,
    scan_at,
    serving,
    vectors_of,
)
from fusionslam.datasets import write_cloud
from fusionslam.descriptors import describe
from fusionslam.sensors.frame import Cloud


@pytest.fixture
def scan(tmp_path: Path) -> Cloud:
    return Cloud(scan_at("yard", 1.3))


@pytest.mark.parametrize("form", ["ply", "pcd", "bin", "npy"])
def test_a_cloud_of_each_format_is_described_as_the_library_does(
    client: Any, scan: Cloud, form: str, tmp_path: Path
) -> None:
    path = tmp_path / f"scan.{form}"
    if form == "npy":
        np.save(path, scan.points)
    else:
        write_cloud(path, scan)
    answer = client.post(f"/v1/describe?format={form}", content=path.read_bytes())
    assert answer.status_code == 200
    found = answer.json()
    assert found["descriptor"] == "m2dp:robust" and found["points"] == len(scan)
    assert np.array_equal(np.float32(found["vector"]), describe(scan, "m2dp:robust"))


def test_the_content_type_names_the_format(client: Any, scan: Cloud) -> None:
    head = {"Content-Type": "application/x-npy"}
    answer = client.post("/v1/describe", content=as_npy(scan.points), headers=head)
    assert answer.json()["length"] == LENGTH


def test_points_with_nan_are_left_out_as_everywhere(client: Any, scan: Cloud) -> None:
    holes = np.concatenate([scan.points, np.full((50, 3), np.nan, np.float32)])
    answers = [
        client.post("/v1/describe?format=npy", content=as_npy(points)).json()["vector"]
        for points in (scan.points, holes)
    ]
    assert answers[0] == answers[1]


def test_a_cloud_finds_places_of_its_site(client: Any, scan: Cloud) -> None:
    answer = client.post("/v1/query?format=npy&k=3", content=as_npy(scan.points)).json()
    (found,) = answer["results"]
    assert [each["site"] for each in found] == ["yard"] * 3
    distances = [each["distance"] for each in found]
    assert distances == sorted(distances)
    assert found[0]["pose"] == pose_at(found[0]["frame"]).tolist()


def test_vectors_are_searched_one_by_one_or_together(made: Path) -> None:
    vectors = vectors_of(sum(b"monday"), 20)
    with serving(made) as client:
        one = client.post("/v1/query", json={"vector": vectors[7].tolist()})
        some = client.post("/v1/query", json={"vectors": vectors[3:6].tolist()})
        binary = client.post("/v1/query?format=vectors", content=as_npy(vectors[3:6]))
    assert [found[0]["frame"] for found in one.json()["results"]] == [7]
    assert [found[0]["frame"] for found in some.json()["results"]] == [3, 4, 5]
    assert binary.json() == some.json()


@pytest.mark.parametrize(
    ("filter", "count"),
    [
        ("site=depot", 20),
        ("site=yard", 0),
        ("robot=blue", 10),
        ("region=north&robot=red", 20),
        ("session=tuesday", 10),
        ("since_ns=5000000000&until_ns=7000000000", 4),
        ("site=it's", 0),
    ],
)
def test_only_places_that_are_meant_are_found(made: Path, filter: str, count: int) -> None:
    add_places(made, "tuesday", 10, robot="blue", site="dock")
    with serving(made) as client:
        answer = client.post(
            f"/v1/query?k=50&{filter}", json={"vector": vectors_of(1, 1)[0].tolist()}
        )
    assert len(answer.json()["results"][0]) == count


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


@pytest.mark.parametrize("site", ["", "a/b", "zwölf <i>", "it's"])
def test_a_site_may_have_any_name(made: Path, site: str) -> None:
    add_places(made, "odd", 5, site=site)
    with serving(made) as client:
        answer = client.get(f"/v1/sites/{quote(site, safe='')}")
        page = client.get(f"/sites/{quote(site, safe='')}")
    assert answer.json()["site"] == site and answer.json()["places"] == 5
    assert page.status_code == 200


def test_health_and_metrics_tell_what_the_service_does(made: Path) -> None:
    with serving(made) as client:
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
    assert {"200", "401", "408", "413", "415", "422", "429", "503"} <= set(
        listed["/v1/query"]["post"]["responses"]
    )
    assert "requestBody" in listed["/v1/locate"]["post"]
