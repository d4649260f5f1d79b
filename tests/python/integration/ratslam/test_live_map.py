# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The files of a map that still grows are those of the run that it comes from."""

import json
from pathlib import Path

import numpy as np
import pytest

from drives import circle_events, process_and_flush, replace_sightings
from fusionslam.datasets.pose_files import read_poses_tum
from fusionslam.errors import DataError
from fusionslam.pipelines.map_events import RunEvents
from fusionslam.pipelines.maps import RunRecorder
from fusionslam.ratslam import GivenViews, LiveMap, OnlineRatSlam, RatSlam
from fusionslam.ratslam.map_export import export_run, write_trajectory


@pytest.fixture(scope="module")
def growing() -> tuple[OnlineRatSlam, RunRecorder]:
    """A map that grows, and the record of the same events."""
    events = replace_sightings(circle_events(1.3))
    online = OnlineRatSlam()
    process_and_flush(online, events)
    nothing = RunEvents("circles", "topic odom", [], np.zeros(0, np.int64), lambda index: index)
    recorder = RunRecorder(RatSlam(views=GivenViews()), nothing)
    for event in events[3:]:  # those before the last one before the first view
        recorder.step(event)
    return online, recorder


def test_the_files_of_the_map_are_those_of_the_run(
    growing: tuple[OnlineRatSlam, RunRecorder], tmp_path: Path
) -> None:
    online, recorder = growing
    live = export_run(tmp_path / "live", online.live_map("circles", "topic odom"))
    assert [path.name for path in live] == [
        "map.json",
        "map.g2o",
        "map.graphml",
        "trajectory.txt",
    ]
    export_run(tmp_path / "run", recorder.record())
    for name in ("map.g2o", "map.graphml"):
        assert (tmp_path / "live" / name).read_bytes() == (tmp_path / "run" / name).read_bytes()
    maps = [json.loads((tmp_path / name / "map.json").read_text()) for name in ("live", "run")]
    found, whole = (each.pop("trajectory") for each in maps)
    assert maps[0].pop("digest") != maps[1].pop("digest")
    assert maps[0] == maps[1] and len(maps[0]["nodes"]) > 10
    nodes = [[node[name] for name in ("x", "y", "heading")] for node in maps[0]["nodes"]]
    assert found["final"] == nodes and found["node"] == list(range(len(nodes)))
    assert found["live"] is None is found["dead_reckoning"] is found["truth"]
    assert found.keys() == whole.keys()


def test_the_way_of_a_live_map_are_its_nodes_in_time(
    growing: tuple[OnlineRatSlam, RunRecorder], tmp_path: Path
) -> None:
    live = growing[0].live_map("circles", "topic odom")
    write_trajectory(tmp_path / "t.txt", live)
    stamps_ns, poses = read_poses_tum(tmp_path / "t.txt")
    np.testing.assert_array_equal(stamps_ns, live.node_stamps_ns)
    np.testing.assert_allclose(poses[:, :2, 3], live.nodes[:, :2], atol=1e-12)
    for which in ("live", "dead_reckoning"):
        with pytest.raises(DataError, match="circles"):
            write_trajectory(tmp_path / "no.txt", live, which)


def test_a_live_map_is_a_copy(growing: tuple[OnlineRatSlam, RunRecorder]) -> None:
    slam = growing[0].slam
    live = LiveMap.of(slam, "circles", "topic odom")
    live.nodes[:] = 0
    live.links["distance"] = 0
    assert np.abs(slam.map.nodes).max() > 1 and slam.map.links["distance"].max() > 0.1


def test_a_map_without_nodes_has_files_without_nodes(tmp_path: Path) -> None:
    export_run(tmp_path, OnlineRatSlam().live_map("nothing", "none"))
    assert json.loads((tmp_path / "map.json").read_text())["nodes"] == []
    assert (tmp_path / "trajectory.txt").read_text() == (tmp_path / "map.g2o").read_text() == ""
