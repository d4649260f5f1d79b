# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Maps and trajectories in files, read back by other readers; those of a map that still grows."""

import errno
import json
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

from drives import circle_events, process_and_flush, replace_sightings
from error_codes import has_code
from fusionslam import ConfigError, DataError
from fusionslam.datasets.pose_files import read_poses_tum
from fusionslam.evaluation.maps.run import LINK, RatSlamRun, place_on_map
from fusionslam.pipelines.map_events import RunEvents
from fusionslam.pipelines.maps import RunRecorder
from fusionslam.ratslam import GivenViews, LiveMap, OnlineRatSlam, RatSlam
from fusionslam.ratslam.map_export import (
    TRAJECTORIES,
    UNITS,
    export_run,
    write_g2o,
    write_graphml,
    write_map_json,
    write_trajectory,
)
from maps import little_run, square_run
from rows import rows

WRITERS = [write_map_json, write_trajectory, write_g2o, write_graphml]


def shaken_run() -> RatSlamRun:
    """Numbers with many digits, offsets that count, and stamps of today that come twice."""
    rng = np.random.default_rng(4)
    run = square_run()
    stamps = 1_700_000_000_123_456_789 + run.stamps_ns
    stamps[3] = stamps[2]
    return replace(
        run,
        name='"<square> & Söhne"',
        config={"map": {"loops": 20}},
        stamps_ns=stamps,
        node_stamps_ns=stamps[:4],
        nodes=run.nodes + rng.normal(0, 0.1, (4, 3)),
        offsets=rng.normal(0, 0.3, (8, 3)),
        poses=run.poses + rng.normal(0, 0.1, (8, 3)),
    )


def numbers(path: Path, tag: str) -> Any:
    lines = [line.split() for line in path.read_text().splitlines()]
    return np.array([line[1:] for line in lines if line[0] == tag], np.float64)


def test_json_holds_nodes_links_and_trajectories_with_units(tmp_path: Path) -> None:
    run = shaken_run()
    write_map_json(tmp_path / "map.json", run)
    read = json.loads((tmp_path / "map.json").read_text())
    assert read["format"] == "fusionslam.experience_map.1"
    assert (read["name"], read["config"]) == (run.name, {"map": {"loops": 20}})
    nodes = [[node[name] for name in ("x", "y", "heading")] for node in read["nodes"]]
    np.testing.assert_array_equal(nodes, run.nodes)
    assert [node["id"] for node in read["nodes"]] == [0, 1, 2, 3]
    assert [node["stamp_ns"] for node in read["nodes"]] == run.node_stamps_ns.tolist()
    for name in LINK.names:
        assert [link[name] for link in read["links"]] == run.links[name].tolist()
    trajectory = read["trajectory"]
    assert trajectory["stamps_ns"] == run.stamps_ns.tolist()
    assert trajectory["node"] == run.node_ids.tolist()
    for name, poses in (("live", run.poses), ("final", run.final_poses), ("truth", run.truth)):
        np.testing.assert_array_equal(trajectory[name], poses)
    ids = {"source", "target", "id", "view"}
    assert {*read["nodes"][0], *read["links"][0]} - ids == set(read["units"]) == set(UNITS)


def test_unknown_true_poses_are_null_and_have_no_lines(tmp_path: Path) -> None:
    run = square_run()
    run.truth[[0, 5]] = np.nan
    write_map_json(tmp_path / "map.json", run)
    truth = json.loads((tmp_path / "map.json").read_text())["trajectory"]["truth"]
    assert [row is None for row in truth] == [k in (0, 5) for k in range(8)]
    write_trajectory(tmp_path / "t.txt", run, "truth")
    stamps = read_poses_tum(tmp_path / "t.txt")[0]
    np.testing.assert_array_equal(stamps, np.delete(run.stamps_ns, [0, 5]))


@rows("which", list(TRAJECTORIES))
def test_tum_lines_hold_the_last_pose_of_each_stamp(tmp_path: Path, which: str) -> None:
    run = shaken_run()
    write_trajectory(tmp_path / "t.txt", run, which)
    stamps, poses = read_poses_tum(tmp_path / "t.txt")
    kept = [0, 1, 3, 4, 5, 6, 7]
    np.testing.assert_array_equal(stamps, run.stamps_ns[kept])
    wanted = {"final": run.final_poses, "live": run.poses}.get(which, getattr(run, which, None))
    np.testing.assert_allclose(poses[:, :2, 3], wanted[kept, :2], rtol=0, atol=1e-12)
    turns = np.arctan2(poses[:, 1, 0], poses[:, 0, 0])
    np.testing.assert_allclose(np.exp(1j * turns), np.exp(1j * wanted[kept, 2]), atol=1e-12)


def test_g2o_holds_vertices_and_edges_that_optimisers_read(tmp_path: Path) -> None:
    run = shaken_run()
    write_g2o(tmp_path / "map.g2o", run)
    np.testing.assert_array_equal(
        numbers(tmp_path / "map.g2o", "VERTEX_SE2"), np.column_stack([np.arange(4), run.nodes])
    )
    np.testing.assert_array_equal(numbers(tmp_path / "map.g2o", "FIX"), [[0]])
    edges = numbers(tmp_path / "map.g2o", "EDGE_SE2")
    np.testing.assert_array_equal(edges[:, :2].T, [run.links["source"], run.links["target"]])
    assert (edges[0, 5:] == [1, 0, 0, 1, 0, 4]).all()  # of 1 m, and of 0.5 rad


def test_an_edge_of_g2o_weighs_what_its_link_deviates(tmp_path: Path) -> None:
    run = square_run()
    run.links["sd_m"], run.links["sd_rad"] = [0.1, 0.3, 2.0, 1.0], [0.02, 0.5, 1.0, 3.0]
    write_g2o(tmp_path / "map.g2o", run)
    for edge, link in zip(numbers(tmp_path / "map.g2o", "EDGE_SE2"), run.links, strict=True):
        information = np.zeros((3, 3))
        information[np.triu_indices(3)] = edge[5:]
        deviations = [link["sd_m"], link["sd_m"], link["sd_rad"]]
        np.testing.assert_allclose(np.linalg.inv(information), np.diag(np.square(deviations)))


@rows("name", ["sd_m", "sd_rad"])
def test_a_link_that_deviates_by_nothing_has_no_edge_of_g2o(tmp_path: Path, name: str) -> None:
    run = square_run()
    run.links[name][2] = 0.0
    with pytest.raises(DataError, check=has_code("no-deviation", 2)):
        write_g2o(tmp_path / "map.g2o", run)
    assert list(tmp_path.iterdir()) == []


def test_following_an_edge_of_g2o_leads_from_one_node_to_the_next(tmp_path: Path) -> None:
    run = square_run()  # its links fit its nodes
    write_g2o(tmp_path / "map.g2o", run)
    edges = numbers(tmp_path / "map.g2o", "EDGE_SE2")
    reached = place_on_map(run.nodes, edges[:, 0].astype(np.int64), edges[:, 2:5])
    wanted = run.nodes[edges[:, 1].astype(np.int64)]
    np.testing.assert_allclose(reached[:, :2], wanted[:, :2], rtol=0, atol=1e-12)
    np.testing.assert_allclose(np.exp(1j * reached[:, 2]), np.exp(1j * wanted[:, 2]), atol=1e-12)


def test_networkx_reads_the_graphml_with_its_types(tmp_path: Path) -> None:
    networkx = pytest.importorskip("networkx", reason="networkx is not installed")
    run = shaken_run()
    write_graphml(tmp_path / "map.graphml", run)
    graph = networkx.read_graphml(tmp_path / "map.graphml")
    assert graph.is_directed() and graph.graph["name"] == run.name
    assert list(graph.nodes) == ["n0", "n1", "n2", "n3"]
    for node, pose, stamp in zip(graph, run.nodes, run.node_stamps_ns, strict=True):
        found = graph.nodes[node]
        assert [found[name] for name in ("x", "y", "heading")] == pose.tolist()
        assert found["stamp_ns"] == stamp and isinstance(found["view"], int)
    for link in run.links:
        edge = graph.edges[f"n{link['source']}", f"n{link['target']}"]
        for name in LINK.names[2:]:
            assert edge[name] == link[name]


def test_graphml_declares_every_attribute_before_it_uses_it(tmp_path: Path) -> None:
    write_graphml(tmp_path / "map.graphml", shaken_run())
    root = ElementTree.parse(tmp_path / "map.graphml").getroot()
    tags = [child.tag.rpartition("}")[2] for child in root]
    assert tags == ["key"] * (len(tags) - 1) + ["graph"]
    keys = [child.get("id") for child in root[:-1]]
    assert len(keys) == len(set(keys))
    assert {data.get("key") for data in root.iter() if data.tag.endswith("}data")} == set(keys)


def test_every_format_is_written_into_a_folder_and_named(tmp_path: Path) -> None:
    paths = export_run(tmp_path / "new" / "folder", square_run())
    assert sorted(paths) == sorted((tmp_path / "new" / "folder").iterdir())
    assert len(paths) == 7
    unknown = export_run(tmp_path / "b", square_run(truth=None))
    assert {path.name for path in paths} - {path.name for path in unknown} == {"truth.txt"}


def test_the_same_run_gives_the_same_bytes(tmp_path: Path) -> None:
    files = [export_run(tmp_path / name, shaken_run()) for name in ("a", "b")]
    assert len({tuple(path.read_bytes() for path in paths) for paths in files}) == 1


def test_an_empty_run_gives_files_without_nodes(tmp_path: Path) -> None:
    for run in (little_run([], [], [], []), little_run([(0, 0, 0)], [(0, 0, 0)], [], [])):
        paths = export_run(tmp_path, run)
        assert all(path.exists() for path in paths)
        assert json.loads((tmp_path / "map.json").read_text())["nodes"] == []
        assert (tmp_path / "map.g2o").read_text() == ""


@rows("write", WRITERS)
def test_paths_that_cannot_be_written_leave_nothing(tmp_path: Path, write: Any) -> None:
    (tmp_path / "file").write_text("")
    (tmp_path / "folder").mkdir()
    for path in (tmp_path / "file" / "map", tmp_path / "folder"):
        with pytest.raises(DataError, match=path.name):
            write(path, square_run())
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file", "folder"]


@contextmanager
def without_rights() -> Iterator[None]:
    """Runs as a user without rights if the tests run as root."""
    before = os.geteuid()
    if before == 0:
        os.seteuid(65534)
    try:
        yield
    finally:
        os.seteuid(before)


@rows("write, inside", product([*WRITERS, export_run], [".", "locked/below"]))
def test_a_folder_without_permission_is_an_error(tmp_path: Path, write: Any, inside: str) -> None:
    (tmp_path / "locked").mkdir(mode=0)
    tmp_path.chmod(0o555)
    with without_rights(), pytest.raises(DataError, match=os.strerror(errno.EACCES)):
        write(tmp_path / inside / "new" / "map", square_run())
    tmp_path.chmod(0o755)
    assert [path.name for path in tmp_path.iterdir()] == ["locked"]


@rows("write, name", product(WRITERS, ["nodes", "poses", "offsets", "truth", "links"]))
def test_values_that_are_not_finite_are_refused_and_the_old_file_stays(
    tmp_path: Path, name: str, write: Callable[..., None]
) -> None:
    run = square_run()
    values = getattr(run, name).copy()
    if name == "links":
        values["facing"][1] = np.nan
    else:
        values[1, 2] = np.nan
    (tmp_path / "old").write_text("old")
    with pytest.raises(DataError, match=f"{name}.*row 1"):
        write(tmp_path / "old", replace(run, **{name: values}))
    assert (tmp_path / "old").read_text() == "old"


def test_a_missing_or_unknown_trajectory_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(DataError):
        write_trajectory(tmp_path / "t.txt", square_run(truth=None), "truth")
    with pytest.raises(ConfigError, match="last"):
        write_trajectory(tmp_path / "t.txt", square_run(), "last")


Growing = tuple[OnlineRatSlam, RunRecorder]


@pytest.fixture(scope="module")
def growing() -> Growing:
    """A map that grows, and the record of the same events."""
    events = replace_sightings(circle_events(1.3))
    online = OnlineRatSlam()
    process_and_flush(online, events)
    nothing = RunEvents("circles", "topic odom", [], np.zeros(0, np.int64), lambda index: index)
    recorder = RunRecorder(RatSlam(views=GivenViews()), nothing)
    for event in events[3:]:  # those before the last one before the first view
        recorder.step(event)
    return online, recorder


def test_the_files_of_the_map_are_those_of_the_run(growing: Growing, tmp_path: Path) -> None:
    online, recorder = growing
    live = export_run(tmp_path / "live", online.live_map("circles", "topic odom"))
    names = ["map.json", "map.g2o", "map.graphml", "trajectory.txt"]
    assert [path.name for path in live] == names
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


def test_the_way_of_a_live_map_are_its_nodes_in_time(growing: Growing, tmp_path: Path) -> None:
    live = growing[0].live_map("circles", "topic odom")
    write_trajectory(tmp_path / "t.txt", live)
    stamps_ns, poses = read_poses_tum(tmp_path / "t.txt")
    np.testing.assert_array_equal(stamps_ns, live.node_stamps_ns)
    np.testing.assert_allclose(poses[:, :2, 3], live.nodes[:, :2], atol=1e-12)
    for which in ("live", "dead_reckoning"):
        with pytest.raises(DataError, match="circles"):
            write_trajectory(tmp_path / "no.txt", live, which)


def test_a_live_map_is_a_copy(growing: Growing) -> None:
    slam = growing[0].slam
    live = LiveMap.of(slam, "circles", "topic odom")
    live.nodes[:] = 0
    live.links["distance"] = 0
    assert np.abs(slam.map.nodes).max() > 1 and slam.map.links["distance"].max() > 0.1


def test_a_map_without_nodes_has_files_without_nodes(tmp_path: Path) -> None:
    export_run(tmp_path, OnlineRatSlam().live_map("nothing", "none"))
    assert json.loads((tmp_path / "map.json").read_text())["nodes"] == []
    assert (tmp_path / "trajectory.txt").read_text() == (tmp_path / "map.g2o").read_text() == ""
