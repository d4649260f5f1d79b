# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The service: where places and scans are in the joint map of their site."""

import logging
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from artefacts import copy_artefact
from fleet_service import (
    add_places,
    as_npy,
    map_pose_at,
    pose_at,
    scan_at,
    serving,
    write_joint_map,
)
from fusionslam.errors import FusionSlamError
from fusionslam.mapping import PlaceMap
from rows import rows

MONDAY = {frame: 0 for frame in range(0, 20, 2)}


@pytest.fixture
def joined(made: Path) -> Path:
    """Places of three sessions, of which the map has two, and of those one in its first part."""
    pytest.importorskip("small_gicp", reason="maps are an extra")
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


def test_a_joint_map_is_read_again_only_when_its_file_has_changed(
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
    pytest.importorskip("small_gicp", reason="maps are an extra")
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


def test_a_place_whose_cloud_is_gone_proves_nothing_and_others_do(
    fleet: Path, tmp_path: Path
) -> None:
    folder = copy_artefact(fleet, tmp_path / "places")
    add_places(folder, "tuesday", 3, site="yard")  # of a chunk that is not there
    with serving(folder) as client:
        scan = as_npy(scan_at("yard", 1.3))
        found = client.post("/v1/locate?format=npy&site=yard", content=scan).json()
    assert len(found["candidates"]) == 7 and found["place"]["session"].endswith("yard-monday")
