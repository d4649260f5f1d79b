# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Maps of a made street: what is kept, found again and forgotten, and what goes wrong."""

import re
import sqlite3
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from benchmarks.accuracy.never_worse import invent_within_drift
from benchmarks.accuracy.pose_graphs import LOOP_SD
from clouds import scan_blocks
from error_codes import has_code
from fusionslam import Cloud, ConfigError, DataError, FusionConfig, LoopConfig, LoopDetector
from fusionslam.descriptors.own import VARIABLE
from fusionslam.errors import FusionSlamError
from fusionslam.geometry.se3 import exp, log
from fusionslam.mapping.config import MapConfig
from fusionslam.mapping.edge import Edge
from fusionslam.mapping.graph_export import write_map_graph
from fusionslam.mapping.map_database import is_map
from fusionslam.mapping.map_file import MapFile
from fusionslam.mapping.map_schema import APPLICATION_ID, VERSION
from fusionslam.mapping.place_map import PlaceMap
from fusionslam.sensors.frame import Frame
from map_fixtures import FRAMES, build
from pages import DOCS, snippets
from refusals import refuses
from rows import rows
from streets import OPTIONS, RETURN, WAY, assert_near, at, changed, drift, error, frames

gtsam = pytest.importorskip("gtsam", reason="the library of pose graphs is an extra")


def test_loops_correct_the_trajectory(path: Path) -> None:
    with PlaceMap.open(path, read_only=True) as site:
        stamps, poses = site.trajectory("monday")
        assert stamps.tolist() == [frame.stamp_ns for frame in FRAMES]
        assert error(site.odometry("monday"), WAY) > 1.0
        assert error(poses, WAY) < 0.25
        np.testing.assert_allclose(poses[0], np.eye(4), atol=1e-9)
        assert all(edge.state == "believed" and edge.reason is None for edge in site.loops)


def test_edges_join_the_keyframes_of_sessions(path: Path) -> None:
    with PlaceMap.open(path, read_only=True) as site:
        numbers = site.keyframes("monday").tolist()
        assert numbers == [*range(len(WAY))]
        assert {number for edge in site.edges for number in (edge.a, edge.b)} == {*numbers}
        assert site.config["descriptor"] == "m2dp" and "drift" in site.config["mapping"]


def thinned(given: list[Frame], step: int) -> list[Frame]:
    """What a sensor with fewer points sees."""
    return [changed(each, points=np.ascontiguousarray(each.points[::step])) for each in given]


@pytest.mark.slow
@rows("of_map, asked, is_found", [(1, 4, True), (1, 25, False), (1, 60, False), (10, 1, None)])
def test_a_sensor_of_another_density_is_found_rightly_or_not_at_all(
    of_map: int, asked: int, is_found: bool | None, street_map: Path, tmp_path: Path
) -> None:
    path = street_map
    if of_map > 1:
        path = tmp_path / "site.fsmap"
        build(path, thinned(FRAMES[:9], of_map))
    with PlaceMap.open(path, read_only=True) as site:
        keyframes = site.trajectory("monday")[1]
        seen = thinned(frames(RETURN[:3], 200, day=1), asked)
        for frame, truth in zip(seen, RETURN[:3], strict=True):
            site.forget_motion()
            found = site.localize(frame)
            assert is_found is None or (found.pose is not None) == is_found
            if found.pose is None:
                assert found.reason is not None
                continue
            # The map itself may have drifted.
            at_keyframe = np.linalg.inv(keyframes[found.keyframe]) @ found.pose
            assert_near(at_keyframe, np.linalg.inv(WAY[found.keyframe]) @ truth, 0.3, 0.6)


@pytest.mark.slow
def test_a_map_that_is_closed_in_between_is_the_same(path: Path, tmp_path: Path) -> None:
    other, steps = tmp_path / "parts.fsmap", []
    for part in (FRAMES[:7], FRAMES[7:12], FRAMES[12:]):
        steps += build(other, part)
    assert [step.keyframe for step in steps] == [*range(len(WAY))]
    assert sum(len(step.loops) for step in steps) >= 6
    assert steps[0].loops == () and steps[0].why is None
    with PlaceMap.open(path, read_only=True) as one, PlaceMap.open(other) as two:
        poses = two.trajectory("monday")[1]
        np.testing.assert_array_equal(one.trajectory("monday")[1], poses)
        assert [(e.a, e.b, e.state) for e in one.edges] == [(e.a, e.b, e.state) for e in two.edges]
        assert two.last_frame is None  # opened without a session
        # A step says where the robot is; the map moves it a little further once it is solved.
        np.testing.assert_allclose(steps[-1].pose, poses[-1], atol=0.03)


def test_the_trajectory_while_adding_is_that_of_the_file(path: Path) -> None:
    more = frames(WAY[4:8], seed=50, day=1)
    with PlaceMap.open(path, "tuesday", **OPTIONS) as site:
        loops = [loop for frame in more for loop in site.add(frame).loops]
        live = {name: site.trajectory(name)[1] for name in ("monday", "tuesday")}
    assert len(loops) >= 2
    with PlaceMap.open(path, read_only=True) as site:
        for name, poses in live.items():
            np.testing.assert_array_equal(site.trajectory(name)[1], poses)


def test_frames_nearby_are_no_keyframes(new: PlaceMap) -> None:
    new.add(FRAMES[0])
    near = at(0.5, 0.0, 3.0, 0.0)
    step = new.add(FRAMES[1], odometry=near)
    assert step.keyframe is None
    np.testing.assert_allclose(step.pose, near, atol=1e-9)
    assert new.add(FRAMES[1], odometry=at(0.0, 0.0, 20.0, 0.0)).keyframe == 1


def test_the_folder_of_a_new_map_is_made(tmp_path: Path) -> None:
    path = tmp_path / "out" / "new" / "site.fsmap"
    build(path, FRAMES[:1])
    assert is_map(path)
    path.parent.joinpath("file").touch()
    with refuses("cannot-write"):
        build(path.parent / "file" / "site.fsmap", FRAMES[:1])


def test_others_read_while_one_writes(new: PlaceMap, tmp_path: Path) -> None:
    path = tmp_path / "a.fsmap"
    new.add(FRAMES[0])
    with PlaceMap.open(path, read_only=True) as other:
        assert len(other) == 1
        new.add(FRAMES[1])
    with PlaceMap.open(path, read_only=True) as other:
        assert len(other) == 2
    with pytest.raises(DataError, match=str(path), check=has_code("locked")):
        PlaceMap.open(path, "tuesday")


@rows("truth", [at(1.0, 0.5, 30), at(-11.0, -0.5, 180)])
def test_a_robot_is_found_without_a_guess(path: Path, truth: Any) -> None:
    with PlaceMap.open(path, read_only=True) as site:
        found = site.localize(Cloud(scan_blocks(truth, 99)))
    assert found.reason is None
    assert_near(found.pose, np.linalg.inv(WAY[0]) @ truth, 0.4, 3)


def test_the_covariance_of_a_robot_is_that_of_its_own_frame(path: Path) -> None:
    points = scan_blocks(at(1.0, 0.5, 30), 99)
    mount = at(2.0, 0.5, 90)
    frame = Frame(points=points, robot_from_points=mount)
    with PlaceMap.open(path, read_only=True) as site:
        robot, cloud = site.localize(frame), site.localize(Cloud(points))
    assert robot.pose is not None and cloud.pose is not None
    np.testing.assert_allclose(robot.pose @ mount, cloud.pose, atol=1e-9)
    # A small motion v of the cloud's frame moves the robot's by the same motion of the world.
    rng = np.random.default_rng(0)
    moves = 1e-4 * rng.multivariate_normal(np.zeros(6), cloud.covariance, 20_000)
    moved = exp(moves) @ np.linalg.inv(mount)
    sampled = np.cov((log(mount @ moved) / 1e-4).T)
    scale = np.sqrt(np.outer(np.diag(sampled), np.diag(sampled)))
    np.testing.assert_allclose(robot.covariance / scale, sampled / scale, atol=0.04)


def test_a_robot_elsewhere_is_not_found(path: Path) -> None:
    points = scan_blocks(at(1.0, 0.5, 30), 99, place=13)
    with PlaceMap.open(path, read_only=True) as site:
        found = site.localize(Cloud(points))
    assert found.pose is None and found.reason is not None


@pytest.mark.slow
def test_the_next_day_joins_the_map_and_can_be_forgotten(path: Path) -> None:
    build(path, frames(RETURN, 200, day=1), "tuesday")
    with PlaceMap.open(path) as site:
        assert [each.name for each in site.sessions] == ["monday", "tuesday"]
        assert [each.parts for each in site.sessions] == [(0,), (0,)]
        truth = np.array([np.linalg.inv(WAY[0]) @ pose for pose in RETURN])
        off = site.trajectory("tuesday")[1][:, :3, 3] - truth[:, :3, 3]
        assert np.linalg.norm(off, axis=1).max() < 0.6
        site.forget("tuesday")
        assert [each.name for each in site.sessions] == ["monday"]
        assert len(site) == len(WAY) and site.check() == []
        with pytest.raises(ConfigError):
            site.trajectory("tuesday")


def test_an_open_session_that_is_forgotten_begins_anew(path: Path) -> None:
    with PlaceMap.open(path, "monday") as site:
        site.forget("monday")
        assert len(site) == 0 and not site.sessions
        assert [site.add(frame).keyframe is not None for frame in FRAMES[:2]] == [True, True]
        assert [each.keyframes for each in site.sessions] == [2]
    with PlaceMap.open(path, read_only=True) as site:
        assert len(site) == 2 and site.check() == []


def test_turns_within_scans_are_said_and_make_poses_less_certain(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path, turning = tmp_path / "a.fsmap", drift(WAY[:3], turn_deg=20)

    def see(k: int, seconds: float) -> Frame:
        """A frame whose scan takes some seconds, while the robot turns by 20 degrees a second."""
        points = FRAMES[k].points
        assert points is not None
        times = np.linspace(0, seconds, len(points))
        stamp_ns = (k + 1) * 10**9
        return Frame(points=points, stamp_ns=stamp_ns, point_seconds=times, odometry=turning[k])

    with PlaceMap.open(path, "a", **OPTIONS) as site:
        assert [site.add(see(k, 0.1)).keyframe for k in range(3)] == [0, 1, 2]
        assert not caplog.records
    with PlaceMap.open(path, read_only=True) as site:
        *_, found = (site.localize(see(k, 0.2)) for k in range(3))
        floor = site.settings.registration.angle_sd**2
    assert found.covariance is not None
    said = [each for each in caplog.records if each.args and each.args[0] == str(path)]
    assert len(said) == 2  # of what was added, and of what was localised
    assert said[0].args is not None and said[0].args[1:3] == pytest.approx((2, 2), abs=0.01)
    variance = np.degrees(np.degrees(found.covariance[5, 5]))
    # That of the scan, 4 degrees in 0.2 s, and of the keyframe, 2 in 0.1 s.
    np.testing.assert_allclose(variance - floor, (4**2 + 2**2) / 3, rtol=0.01)


def test_steps_count_without_loops(tmp_path: Path) -> None:
    build(tmp_path / "a.fsmap", FRAMES[:6])
    with PlaceMap.open(tmp_path / "a.fsmap") as site:
        assert site.loops == ()
        by_odometry = error(site.odometry("monday"), WAY[:6])
        assert error(site.trajectory("monday")[1], WAY[:6]) < by_odometry
        site.solve()
        assert error(site.trajectory("monday")[1], WAY[:6]) < by_odometry


def test_poses_of_before_a_solution_confirm_nothing_after_it(path: Path) -> None:
    with PlaceMap.open(path) as site:
        assert site.localize(FRAMES[0]).pose is not None
        assert site._localizer is not None and site._localizer._past
        site.solve()
        assert not site._localizer._past


def test_the_cloud_and_the_grid_are_those_of_the_street(path: Path) -> None:
    with PlaceMap.open(path, read_only=True) as site:
        cloud, grid = site.cloud(voxel=0.5), site.grid(resolution=0.5)
        heights = site.heights(resolution=0.5).heights
    assert cloud.colors is None
    size = np.ptp(cloud.points, axis=0)
    assert 80 < size[0] < 115 and 50 < size[1] < 65
    assert (grid.cells == 0).sum() > 1000 and (grid.cells == 100).sum() > 100
    column, row = (int((0.0 - start) / 0.5) for start in grid.origin)
    assert grid.cells[row, column] == 0  # the robot stood there
    assert np.nanmax(heights) > 4


@pytest.mark.slow
def test_a_drive_elsewhere_is_a_part_and_a_graph_of_its_own(path: Path, tmp_path: Path) -> None:
    build(path, frames(RETURN[:5], 200, day=1, place=13), "elsewhere")
    with PlaceMap.open(path) as site:
        assert site.sessions[1].parts == (len(WAY),)
        assert all(edge.state != "believed" for edge in site.loops if edge.kind == "merge")
        site.solve()
        write_map_graph(tmp_path / "graph.g2o", site.content)
        poses = site.trajectory("monday")[1]
        believed = [edge for edge in site.edges if edge.state == "believed"]
        other = {*site.keyframes("elsewhere").tolist()}
    factors, values = gtsam.readG2o(str(tmp_path / "graph.g2o"), True)
    assert values.size() == len(WAY)
    assert factors.size() == sum(edge.a not in other for edge in believed)
    written = np.array([values.atPose3(number).translation() for number in range(len(WAY))])
    np.testing.assert_allclose(written, poses[:, :3, 3], atol=1e-6)
    firm = gtsam.noiseModel.Isotropic.Sigma(6, 1e-6)
    factors.add(gtsam.PriorFactorPose3(0, values.atPose3(0), firm))
    best = gtsam.LevenbergMarquardtOptimizer(factors, values).optimize()
    moved = [best.atPose3(number).translation() - written[number] for number in range(len(WAY))]
    assert np.linalg.norm(moved, axis=1).max() < 5e-3


@pytest.mark.nightly
def test_keyframes_of_another_part_do_not_keep_a_robot_from_being_found(tmp_path: Path) -> None:
    path = tmp_path / "site.fsmap"
    # In its own frame the other street's crowd of keyframes is where the robot is in this one's.
    crowd = [WAY[0], *(at(-11.0, -0.5, 20 * step) for step in range(8))]
    build(path, frames(crowd, 300, place=13), "elsewhere")
    build(path, FRAMES[:6])
    with PlaceMap.open(path, read_only=True) as site:
        assert [each.parts for each in site.sessions] == [(0,), (len(crowd),)]
        found = site.localize(Cloud(scan_blocks(at(-11.0, -0.5, 180), 99)))
    assert found.reason is None and found.keyframe is not None
    assert found.keyframe >= len(crowd) and found.part == len(crowd)


@pytest.mark.nightly
def test_a_map_says_that_odometry_was_trusted_too_much(path: Path, tmp_path: Path) -> None:
    drift = MapConfig().drift.model_dump()
    config = MapConfig(drift={name: value / 10 for name, value in drift.items()})
    with PlaceMap.open(tmp_path / "new.fsmap", "monday", **OPTIONS, config=config) as site:
        for frame in FRAMES:
            site.add(frame)
        assert site.reason is not None and site.reason.code == "overconfident-odometry"
        assert site.reason.number > 1.5
    with PlaceMap.open(path) as site:
        site.solve()
        assert site.reason is None


def test_a_map_stores_that_steps_contradict_loops(path: Path) -> None:
    with PlaceMap.open(path, "monday") as site:
        assert site.reason is None
        poses = site.trajectory("monday")[1]
        rng = np.random.default_rng(1)
        planted = [
            Edge(site.content.next_edge + k, "loop", a, b, pose, np.diag(LOOP_SD**2), "pending")
            for k, (a, b, pose) in enumerate(invent_within_drift(site, 5, 5, 8, 2.0, rng))
        ]
        site.content.take(planted)
        site.solve()
        live = site.trajectory("monday")[1]
        assert error(live, WAY) < 1.02 * error(poses, WAY)
    with PlaceMap.open(path, read_only=True) as site:
        np.testing.assert_allclose(site.trajectory("monday")[1], live, atol=1e-9)
        assert site.reason is not None and site.reason.code == "contradicts-steps"
        assert site.reason.number == 5 and site.reason.text in site.describe()
        states = {edge.state for edge in site.edges[-5:]}
        assert states == {"refused"}


def test_steps_that_clouds_measure_are_firmer_than_loops(path: Path) -> None:
    with PlaceMap.open(path, read_only=True) as site:
        measured = [edge for edge in site.edges if edge.kind == "loop" and edge.b == edge.a + 1]
        loops = site.loops
    assert len(measured) > 10
    assert all(np.linalg.eigvalsh(edge.covariance)[0] > 0 for edge in measured)
    of_steps, of_loops = (
        np.sqrt([edge.covariance[0, 0] for edge in edges]) for edges in (measured, loops)
    )
    assert of_steps.min() >= MapConfig().step_sd
    assert np.median(of_steps) < of_loops.min()


def test_steps_of_sectors_are_no_firmer_than_loops(tmp_path: Path) -> None:
    ahead = [
        changed(frame, points=frame.points[np.abs(frame.points[:, 1]) < frame.points[:, 0]])
        for frame in FRAMES[:3]
        if frame.points is not None
    ]
    build(tmp_path / "a", ahead, "a")
    with PlaceMap.open(tmp_path / "a", read_only=True) as site:
        measured = [edge for edge in site.edges if edge.kind == "loop"]
        floor = site.settings.registration.position_sd
    assert measured and all(edge.covariance[0, 0] >= floor**2 for edge in measured)


@pytest.mark.slow
@pytest.mark.parametrize("gap", [pytest.param(0, marks=pytest.mark.nightly), 5])
def test_a_short_drive_is_joined_with_the_same_drive_of_another_day(
    tmp_path: Path, gap: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Keyframes of other sessions are candidates, however few came since."""
    asked = []
    add = LoopDetector.add_observation

    def watched(self: LoopDetector, seen: Any, *, excluded: Any, stretches: Any) -> Any:
        asked.append((len(self), {*excluded}, {stretches[k] for k in excluded}))
        return add(self, seen, excluded=excluded, stretches=stretches)

    monkeypatch.setattr(LoopDetector, "add_observation", watched)
    path, loops = tmp_path / "site.fsmap", LoopConfig(window=20)
    for part in (slice(0, gap), slice(gap, None)):
        for day, name in enumerate(("monday", "tuesday")):
            build(path, frames(RETURN, 200 * day, day=day)[part], name, loops=loops)
    with PlaceMap.open(path, read_only=True) as site:
        assert [each.parts for each in site.sessions] == [(0,), (0,)]
        numbers = {each.name: [*site.keyframes(each.name)] for each in site.sessions}
    own = {"monday": 0, "tuesday": gap or len(RETURN)}
    for number, excluded, stretches in asked:
        session = next(name for name, keyframes in numbers.items() if number in keyframes)
        assert stretches <= {own[session]}
        assert excluded == {k for k in numbers[session] if k < number}


def test_frames_that_say_nothing_change_nothing(path: Path) -> None:
    with PlaceMap.open(path, "monday") as site:
        with refuses("no-odometry"):
            site.add(Frame(index=99, points=FRAMES[0].points))
        for points in (np.empty((0, 3), np.float32), np.full((50, 3), np.nan, np.float32)):
            with pytest.raises(FusionSlamError):
                site.add(Frame(index=99, points=points), odometry=at(0, 15, 0))
            assert len(site) == len(WAY)
    with PlaceMap.open(path, read_only=True) as site:
        assert site.check() == [] and len(site) == len(WAY)


def test_a_full_disk_loses_nothing(path: Path) -> None:
    with PlaceMap.open(path, "monday") as site:
        before = site.trajectory("monday")[1]
        site.file._database.execute("PRAGMA max_page_count = 1")  # SQLite takes the least it can
        with refuses("cannot-write"):
            for k in range(50):
                site.add(FRAMES[3], odometry=at(0, 15.0 + 15 * k, 0))
        kept = site.trajectory("monday")[1]
        np.testing.assert_allclose(kept[: len(before)], before, atol=0.5)
    with PlaceMap.open(path, read_only=True) as site:
        assert site.check() == [] and len(site) == len(kept)


def test_what_is_no_map_is_named(tmp_path: Path) -> None:
    for name, data in {"a.txt": b"hello", "b.fsmap": bytes(100)}.items():
        file = tmp_path / name
        file.write_bytes(data)
        with refuses("other-format", str(file)):
            PlaceMap.open(file, "a")
        assert file.read_bytes() == data and not is_map(file)
    with sqlite3.connect(tmp_path / "c.db") as other:
        other.execute("CREATE TABLE t (x)")
    other.close()
    for path in (tmp_path / "c.db", tmp_path):
        with refuses("other-format"):
            PlaceMap.open(path, "a")
    none, wrong = tmp_path / "none.fsmap", {"voxel": 0.1}
    with refuses("not-found"):
        PlaceMap.open(none, read_only=True)
    with refuses("not-found"):  # a name that was mistyped: nothing could be added
        PlaceMap.open(none)
    with pytest.raises(TypeError, match="MapConfig"):
        PlaceMap.open(none, "a", config=wrong)
    assert not none.exists()


def test_a_configuration_that_is_not_taken_is_named(
    path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with PlaceMap.open(path, "tuesday", **OPTIONS):
        assert not caplog.messages
    chosen = LoopConfig(max_frames=5, verify=False, window=3)  # that of a map is its own
    with PlaceMap.open(path, "tuesday", loops=chosen, fusion=FusionConfig(source="stereo")):
        assert not caplog.messages
    wrong: Any = {"voxel": 0.71}
    with pytest.raises(TypeError, match="MapConfig"):
        PlaceMap.open(path, "tuesday", config=wrong)
    changes = MapConfig(voxel=0.71, drift={"drift_m": 0.031})
    with PlaceMap.open(path, "tuesday", descriptor="shot", config=changes) as site:
        assert site.settings.map != changes
    (message,) = caplog.messages
    for key in ("descriptor=shot", "mapping.voxel=0.71", "mapping.drift.drift_m=0.031"):
        assert key in message
    assert "keyframe_distance" not in message


@rows("share", [0.3, 0.7, 0.97, None])
def test_a_truncated_map_is_damaged(path: Path, tmp_path: Path, share: float | None) -> None:
    assert is_map(path)
    data, cut = path.read_bytes(), tmp_path / "cut.fsmap"
    cut.write_bytes(data[:-100] if share is None else data[: int(share * len(data))])
    with refuses("damaged", *([str(cut)] if share is None else [])):
        with PlaceMap.open(cut, read_only=True) as site:
            problems = site.check()
        assert share is not None and problems
        raise DataError("; ".join(problems), code="damaged")


def test_a_map_of_a_later_version_is_refused(path: Path) -> None:
    with sqlite3.connect(path) as database:
        database.execute(f"PRAGMA user_version = {VERSION + 1}")
    database.close()
    with refuses("newer-version", str(path), str(VERSION + 1)):
        PlaceMap.open(path, "monday")


def test_the_file_says_what_it_is(path: Path) -> None:
    database = sqlite3.connect(path)
    assert database.execute("PRAGMA application_id").fetchone() == (APPLICATION_ID,)
    assert database.execute("PRAGMA page_size").fetchone() == (65536,)
    assert database.execute("PRAGMA journal_mode").fetchone() == ("wal",)
    database.close()


def test_read_only_maps_do_not_change(path: Path) -> None:
    with PlaceMap.open(path, "monday", read_only=True) as site:
        with refuses("read-only", error=ConfigError):
            site.add(FRAMES[0])
        with refuses("read-only", error=ConfigError):
            site.forget("monday")
    with PlaceMap.open(path) as site, refuses("choice", error=ConfigError):
        site.add(FRAMES[0])


def test_a_map_keeps_the_configuration_that_it_was_made_with(path: Path) -> None:
    config = MapConfig(keyframe_distance=1000.0)
    with PlaceMap.open(path, "monday", descriptor="cm2dp", config=config) as site:
        assert site.add(frames(RETURN[:1])[0], odometry=at(0, 12, 0)).keyframe == len(WAY)


def test_the_log_beside_a_map_stays_small(tmp_path: Path) -> None:
    with MapFile(tmp_path / "site.fsmap") as file:
        for number in range(200):
            with file.transaction():
                file.store_setting("a", "x" * 200_000 + str(number))
        assert (tmp_path / "site.fsmap-wal").stat().st_size < 10e6


def test_a_descriptor_may_be_named_with_its_preset(tmp_path: Path) -> None:
    build(tmp_path / "a", FRAMES[:3], "a", descriptor="m2dp:author")
    with PlaceMap.open(tmp_path / "a", read_only=True) as site:
        assert len(site) == 3 and site.settings.descriptor == "m2dp:author"
        assert site.localize(Cloud(scan_blocks(WAY[1], 77))).keyframe == 1


def test_the_tables_of_the_page_are_those_of_the_file(short: Path) -> None:
    database = sqlite3.connect(short)
    tables = database.execute("SELECT name FROM sqlite_master WHERE type = 'table'").fetchall()
    stored = {
        (table, column)
        for (table,) in tables
        for _, column, *_ in database.execute(f"PRAGMA table_info({table})")
    }
    version = database.execute("PRAGMA user_version").fetchone()[0]
    database.close()
    text = (DOCS / "reference" / "map_file.md").read_text(encoding="utf-8")
    told, table = set(), ""
    for cells in re.findall(r"^\|(.*?)\|(.*?)\|", text, re.MULTILINE):
        names = [re.findall(r"`(\w+)`", cell) for cell in cells]
        table = names[0][0] if names[0] else table
        told |= {(table, column) for column in names[1]}
    assert told == stored
    assert f"the version of the format, {version}." in " ".join(text.split())


def test_the_programs_of_the_page_read_a_map(short: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(short.parent)
    _, read_poses, read_cloud = snippets("reference/map_file")
    names: dict[str, Any] = {}
    exec(read_poses, names)
    exec(read_cloud, names)
    with PlaceMap.open(short, read_only=True) as site:
        np.testing.assert_array_equal([*names["odometry"].values()], site.odometry("monday"))
        assert names["colors"] is None
        shown = site.cloud(voxel=0.1).points
        first = FRAMES[0].points
    assert first is not None and len(shown) >= len(names["points"]) > 100
    np.testing.assert_allclose(np.ptp(names["points"], axis=0), np.ptp(first, axis=0), atol=0.3)


def test_a_map_of_a_users_descriptor_says_what_it_lacks(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    module = ModuleType("mine")
    vars(module)["ranges"] = lambda points: np.histogram(np.hypot(*points[:, :2].T), 20, (0, 60))[0]
    monkeypatch.setitem(sys.modules, "mine", module)
    monkeypatch.setenv(VARIABLE, "mine:ranges")
    build(tmp_path / "a", FRAMES[:3], "a", descriptor="mine:ranges")
    with PlaceMap.open(tmp_path / "a", read_only=True) as site:
        assert site.localize(Cloud(scan_blocks(WAY[1], 77))).keyframe == 1
    monkeypatch.setenv(VARIABLE, "")
    with refuses("unknown-name", "descriptors", "mine:ranges"):
        PlaceMap.open(tmp_path / "a", read_only=True)
