# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The node mapper makes the map that the library makes, and finds the robot on it."""

import os
import threading
from collections.abc import Sequence
from concurrent.futures import CancelledError, ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from artefacts import artefact, copy_artefact
from bags import static
from error_codes import has_code
from fusionslam.errors import ConfigError, DataError
from fusionslam.mapping import PlaceMap
from fusionslam.ros.runtime.diagnostics import diagnostics
from fusionslam.sensors.frame import Frame
from fusionslam.sensors.messages import Fix, FrameTransforms, Odometry, Scan
from place_maps import assert_same_map
from refusals import refuses
from ros_master import needs_ros
from ros_node import Desk
from rows import rows
from streets import OPTIONS, RETURN, WAY, changed, frames

pytestmark = needs_ros
pytest.importorskip("gtsam", reason="the library of pose graphs is an extra")

SECOND = 10**9
START = 1000 * SECOND
MONDAY = frames(WAY)
MADE = {"descriptor": "m2dp", "fusion": {"source": "cloud"}, "loop_closure": {"window": 3}}


SCANNER = FrameTransforms(transforms=(static("base", "scanner", np.eye(4)),))


def start(path: Path, session: str = "monday", **parameters: Any) -> Desk:
    return Desk("mapper", map={"file": str(path), "session": session}, **MADE, **parameters)


def localizer(path: Path) -> Desk:
    return Desk("mapper", map={"file": str(path), "read_only": True})


def drive(desk: Desk, driven: Sequence[Frame], begin_ns: int = START, odom: str = "odom") -> None:
    """The robot's messages of frames."""
    desk.give("/tf_static", SCANNER)
    for each in driven:
        stamp_ns = begin_ns + each.stamp_ns
        if each.odometry is not None:
            moved = Odometry(
                stamp_ns=stamp_ns, frame_id=odom, child_frame_id="base", pose=each.odometry
            )
            desk.give("odom", moved)
        scan = Scan(stamp_ns=stamp_ns, frame_id="scanner", points=each.points)
        desk.give("velodyne_points", scan)
    desk.worker.idle()


def map_from_odom(desk: Desk, now_ns: int = START) -> np.ndarray | None:
    """The transform that the node publishes now; None if it publishes none."""
    count = len(desk.outlet.of("/tf"))
    desk.node.publish_frame(now_ns)
    sent = desk.outlet.of("/tf")[count:]
    if not sent:
        return None
    from fusionslam.datasets.bags.messages import value_of

    (link,) = value_of(sent[0], "tf2_msgs/TFMessage", "/tf").transforms
    assert (link.parent, link.child) == ("map", "odom")
    assert link.stamp_ns == now_ns + SECOND // 10
    return link.parent_from_child


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A map of the street by the node, which says on /tf where it has the robot."""
    kept = artefact("mapper_street_of_node", build)
    return copy_artefact(kept, tmp_path_factory.mktemp("node") / "map") / "site.fsmap"


def build(folder: Path) -> None:
    desk = start(folder / "site.fsmap")
    assert map_from_odom(desk) is None
    drive(desk, MONDAY)
    placed = map_from_odom(desk)
    assert placed is not None and map_from_odom(desk, 0) is None
    desk.node.publish_frame(START)
    assert len(desk.outlet.of("/tf")) == 1  # TF warns of a stamp that it has
    assert desk.problems() == {}
    desk.node.close()
    with PlaceMap.open(folder / "site.fsmap", read_only=True) as site:
        last = site.trajectory("monday")[1][-1]
    np.testing.assert_allclose(placed @ MONDAY[-1].odometry, last, atol=1e-9)
    # Loops have corrected it.
    assert np.linalg.norm(placed[:3, 3]) > 0.1


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same map by the library."""

    def make(folder: Path) -> None:
        with PlaceMap.open(folder / "site.fsmap", "monday", **OPTIONS) as site:
            for each in MONDAY:
                site.add(changed(each, stamp_ns=START + each.stamp_ns))
            site.solve()

    kept = artefact("mapper_street", make)
    return copy_artefact(kept, tmp_path_factory.mktemp("library") / "map") / "site.fsmap"


def test_a_node_makes_the_map_that_the_library_makes(built: Path, library: Path) -> None:
    assert_same_map(built, library)
    with PlaceMap.open(built, read_only=True) as site:
        assert len(site.loops) > 3


def test_a_node_that_ends_goes_on_with_its_session(tmp_path: Path) -> None:
    path = tmp_path / "site.fsmap"
    for part in (MONDAY[:4], MONDAY[4:7]):
        desk = start(path)
        drive(desk, part)
        desk.node.close()
    with PlaceMap.open(path, read_only=True) as site:
        assert site.frames("monday").tolist() == [0, 1, 2, 3, 4, 5, 6]
        assert site.sessions[0].parts == (0,)


@pytest.mark.slow
def test_a_node_puts_its_map_on_the_globe_and_goes_on_with_it(tmp_path: Path) -> None:
    """The receiver is 0.5 m above the robot; the first robot pose is 7 m up, and looks east."""
    pyproj = pytest.importorskip("pyproj")
    enu = pyproj.Transformer.from_pipeline(
        "+proj=pipeline +step +inv +proj=topocentric +ellps=WGS84 +lat_0=49 +lon_0=8.4 +h_0=7 "
        "+step +inv +proj=cart +ellps=WGS84 +step +proj=unitconvert +xy_in=rad +xy_out=deg"
    )
    lever = np.array([0, 0, 0.5, 1])
    path, near = tmp_path / "site.fsmap", np.linalg.inv(WAY[0])
    for part in (range(9), range(9, len(WAY))):
        desk = start(path)
        desk.give("/tf_static", FrameTransforms(transforms=(static("base", "gps", antenna()),)))
        for k in part:
            drive(desk, MONDAY[k : k + 1])
            longitude, latitude, height = enu.transform(*(near @ WAY[k] @ lever)[:3])
            position = np.array([latitude, longitude, height])
            stamp_ns = START + MONDAY[k].stamp_ns
            sure = {"frame_id": "gps", "covariance": np.eye(3) * 0.01}
            desk.give("fix", Fix(stamp_ns=stamp_ns, position=position, **sure))
            late = Fix(stamp_ns=stamp_ns + 60 * SECOND, position=position, **sure)
            desk.give("fix", late)
        desk.node.close()
        assert [*desk.problems().values()] == [len(part)]  # of the other clock
    origin = desk.node._site.content.origin
    assert origin is not None and desk.node.report()["origin"] == str(origin)
    assert origin.altitude == pytest.approx(7, abs=0.2)
    assert (origin.latitude, origin.longitude) == pytest.approx((49, 8.4), abs=3e-6)
    assert origin.heading == pytest.approx(0, abs=1)
    with PlaceMap.open(path, read_only=True) as site:
        # The last one of each part came after the graph was solved.
        assert {p.node for p in site.file.positions()} == {*range(len(WAY))} - {8, len(WAY) - 1}


def antenna() -> np.ndarray:
    pose = np.eye(4)
    pose[2, 3] = 0.5
    return pose


def test_a_new_drive_has_no_place_on_the_map_until_loops_join_it(
    built: Path, tmp_path: Path
) -> None:
    path = copy_artefact(built, tmp_path / "site.fsmap")
    desk, tuesday = start(path, "tuesday"), frames(RETURN, 200, day=1)
    drive(desk, tuesday[:1])
    assert map_from_odom(desk) is None and "not joined" in desk.node.report()["state"]
    drive(desk, tuesday[1:])
    placed = map_from_odom(desk)
    assert placed is not None and desk.node.report()["state"] == "mapping"
    assert np.linalg.norm((placed @ tuesday[-1].odometry)[:3, 3] - _truth(RETURN[-1])) < 0.6
    desk.node.close()


def _truth(pose: np.ndarray) -> np.ndarray:
    return (np.linalg.inv(WAY[0]) @ pose)[:3, 3]


@rows("extended", [False, True])
def test_a_robot_is_found_on_a_map_that_another_node_may_extend(
    extended: bool, built: Path, tmp_path: Path
) -> None:
    path = copy_artefact(built, tmp_path / "site.fsmap")
    writer = start(path, "tuesday") if extended else None
    desk = localizer(path)
    seen = [changed(each, odometry=np.eye(4)) for each in frames(RETURN[3:4], 300, day=2)]
    drive(desk, seen)
    (found,) = desk.outlet.of("~pose")
    place = found.pose.pose.position
    assert np.linalg.norm([place.x, place.y, place.z] - _truth(RETURN[3])) < 0.4
    assert found.header.frame_id == "map" and np.all(np.diag(_matrix(found)) > 0)
    placed = map_from_odom(desk)
    assert placed is not None and np.linalg.norm(placed[:3, 3] - _truth(RETURN[3])) < 0.4
    assert desk.node.report()["state"] == "localised"
    desk.node._answer_forget()
    assert desk.node.report()["state"] == "searching" and map_from_odom(desk, START + 1) is None
    desk.node.close()
    if writer is not None:
        writer.node.close()
    else:
        assert path.read_bytes() == built.read_bytes()
        assert [each.name for each in tmp_path.iterdir()] == ["site.fsmap"]


def _matrix(message: Any) -> np.ndarray:
    return np.reshape(message.pose.covariance, (6, 6))


def level(desk: Desk) -> str:
    """The level that the node reports on /diagnostics, by its name."""
    (status,) = diagnostics(desk.worker, "/mapper", START, {}).status
    names = ("OK", "WARN", "ERROR")
    (found,) = [name for name in names if getattr(status, name) == status.level]
    assert (status.message == "fine") == (found == "OK")
    return found


def test_a_robot_that_maps_says_how_sure_it_is(tmp_path: Path) -> None:
    desk, levels = start(tmp_path / "site.fsmap", mapping={"lost_after": 15.0}), []
    for count in range(4):  # a keyframe each 6.12 m by odometry, and no loop yet
        drive(desk, MONDAY[count : count + 1])
        levels.append(level(desk))
    assert levels == ["OK", "OK", "WARN", "WARN"]
    report, poses = desk.node.report(), desk.outlet.of("~pose")
    assert float(report["unconfirmed [m]"]) == pytest.approx(3 * 6.12, abs=0.01)
    variances = np.array([np.diag(_matrix(each)) for each in poses])
    deviations = np.sqrt(variances[:, :3].sum(axis=1))
    assert len(poses) == 4 and np.all(np.diff(deviations) > 0)
    assert float(report["deviation [m]"]) == pytest.approx(deviations[-1], abs=1e-3)
    desk.node.close()
    with PlaceMap.open(tmp_path / "site.fsmap", read_only=True) as site:
        last, place = site.trajectory("monday")[1][-1], poses[-1].pose.pose.position
    np.testing.assert_allclose([place.x, place.y, place.z], last[:3, 3], atol=1e-3)


@pytest.mark.slow
def test_a_robot_that_is_looked_for_is_lost_without_odometry(built: Path) -> None:
    desk = localizer(built)
    elsewhere = frames(WAY[:1], 400, place=13)
    drive(desk, elsewhere)
    assert level(desk) == "WARN" and not desk.outlet.of("~pose")
    drive(desk, [changed(elsewhere[0], odometry=None)], START + 100 * SECOND)
    assert level(desk) == "ERROR"
    drive(desk, [frames(WAY)[4]], START + 200 * SECOND)
    assert level(desk) == "OK" and len(desk.outlet.of("~pose")) == 1


def test_a_robot_without_odometry_is_found_but_not_mapped(built: Path, tmp_path: Path) -> None:
    blind = [changed(each, odometry=None) for each in MONDAY[2:4]]
    desk = start(tmp_path / "site.fsmap")
    drive(desk, blind)
    (problem,) = desk.problems()
    causes = [cause for _, cause in desk.worker.problems._counts if cause[0] == "no-odometry"]
    assert causes == [("no-odometry",)]  # of all frames: it is logged once
    assert "odom:=" in problem and len(desk.node._site) == 0
    desk.node.close()
    desk = localizer(built)
    drive(desk, blind)
    assert desk.outlet.of("~pose") and map_from_odom(desk) is None


def test_the_first_frame_waits_for_the_first_odometry(tmp_path: Path) -> None:
    desk = start(tmp_path / "site.fsmap")
    desk.give("/tf_static", SCANNER)
    scan = Scan(stamp_ns=START, frame_id="scanner", points=MONDAY[0].points)
    desk.give("velodyne_points", scan)
    moved = Odometry(stamp_ns=START, frame_id="odom", child_frame_id="base", pose=np.eye(4))
    desk.give("odom", moved)
    assert len(desk.node._site) == 1 and desk.problems() == {}
    desk.node.close()


def test_localisations_are_as_far_apart_as_asked(built: Path) -> None:
    desk = localizer(built)
    drive(desk, [frames(WAY)[4]] * 3)  # at one time
    assert desk.node.report()["localisations"] == 1


@pytest.mark.nightly
def test_a_drive_that_is_played_again_goes_on_in_the_same_map(tmp_path: Path) -> None:
    desk = start(tmp_path / "site.fsmap")
    for _ in range(2):
        drive(desk, MONDAY)
    assert any("clock" in text for text in desk.problems())
    assert desk.node.report()["state"] == "mapping"
    desk.node.close()
    with PlaceMap.open(tmp_path / "site.fsmap", read_only=True) as site:
        assert len(site) == 2 * len(WAY) and site.sessions[0].parts == (0,)
        poses = site.trajectory("monday")[1][:, :3, 3]
        truth = np.array([_truth(pose) for pose in [*WAY, *WAY]])
        assert np.linalg.norm(poses - truth, axis=1).max() < 0.6


def test_odometry_in_the_frame_of_the_map_is_named(tmp_path: Path) -> None:
    desk = start(tmp_path / "site.fsmap")
    drive(desk, MONDAY[:1], odom="map")
    assert map_from_odom(desk) is None
    (problem,) = desk.problems()
    assert problem.startswith("/tf") and "~map_frame" in problem
    desk.node.close()


def test_what_nobody_listens_to_is_not_drawn(built: Path, tmp_path: Path) -> None:
    desk = start(tmp_path / "site.fsmap")
    desk.node.draw(START)
    drive(desk, MONDAY[:3])
    desk.node.draw(START)
    assert not desk.outlet.of("~grid")
    desk.outlet.wanted = {"~grid", "~cloud", "~path"}
    for _ in range(2):  # the second time nothing has changed
        desk.node.draw(START)
        desk.node._next_drawing = 0.0
    with PlaceMap.open(tmp_path / "site.fsmap", read_only=True) as site:
        grid, cloud = site.grid(0.1), site.cloud(0.2)
        poses = site.trajectory("monday")[1]
    (drawn,) = desk.outlet.of("~grid")
    assert (drawn.info.height, drawn.info.width) == grid.cells.shape
    assert drawn.data == grid.cells.ravel().tolist()
    assert (drawn.info.origin.position.x, drawn.info.origin.position.y) == grid.origin
    (clouds,) = desk.outlet.of("~cloud")
    assert clouds.width * clouds.height == len(cloud)
    (way,) = desk.outlet.of("~path")
    found = [[each.pose.position.x, each.pose.position.y] for each in way.poses]
    np.testing.assert_allclose(found, poses[:, :2, 3])
    desk.node.close()


def test_services_answer_before_and_after_the_first_frame(tmp_path: Path) -> None:
    desk = start(tmp_path / "site.fsmap")
    answers = {each.name: lambda each=each: each.answer(None) for each in desk.node.services}
    first = answers["~localize"]()
    assert not first.found and first.code == "no-frame" and first.keyframe == -1
    assert answers["~solve"]().success
    drive(desk, MONDAY[:3])
    found = answers["~localize"]()
    assert found.found and found.code == "" and found.keyframe in (0, 1, 2)
    place = found.pose.pose.pose.position
    assert np.linalg.norm([place.x, place.y, place.z] - _truth(WAY[2])) < 0.4
    answers["~forget_motion"]()
    desk.node.close()


def test_services_are_answered_in_the_thread_of_the_node(tmp_path: Path) -> None:
    desk = start(tmp_path / "site.fsmap")
    with ThreadPoolExecutor(3) as callers:
        here = callers.submit(desk.worker.call, threading.get_ident)
        fails = callers.submit(desk.worker.call, lambda: 1 // 0)
        while not (here.done() and fails.done()):
            desk.worker.work(0.01)
        assert here.result() == threading.get_ident()
        assert isinstance(fails.exception(), ZeroDivisionError)
        late = callers.submit(desk.worker.call, lambda: 1)
        while not late.done():
            desk.worker.cancel_calls()
        assert isinstance(late.exception(), CancelledError)
    desk.node.close()


def test_a_map_that_cannot_be_extended_is_named(built: Path, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, check=lambda error: error.fields == ("~map/file",)):
        Desk("mapper")
    writer = start(tmp_path / "site.fsmap")
    with pytest.raises(DataError, match=str(tmp_path), check=has_code("locked")):
        start(tmp_path / "site.fsmap", "tuesday")
    writer.node.close()
    with refuses("not-found"):
        localizer(tmp_path / "none.fsmap")
    with PlaceMap.open(tmp_path / "drive.fsmap", "monday", **OPTIONS) as site:
        site.check_recording("drive.bag")
        site.add(MONDAY[0])
    with refuses("other-recording", error=ConfigError):
        start(tmp_path / "drive.fsmap")
    if os.geteuid():
        (tmp_path / "closed").mkdir(mode=0o500)
        with refuses("cannot-write"):
            start(tmp_path / "closed" / "site.fsmap")


def test_a_full_disk_costs_only_the_frames_of_that_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from fusionslam.mapping.map_file import MapFile

    desk = start(tmp_path / "site.fsmap")
    drive(desk, MONDAY[:2])

    def full(*_: Any) -> None:
        raise DataError("no space left on device", code="cannot-write")

    with monkeypatch.context() as patch:
        patch.setattr(MapFile, "add_keyframe", full)
        drive(desk, MONDAY[2:4])
    assert len(desk.node._site) == 2 and desk.problems()
    drive(desk, MONDAY[4:6])
    desk.node.close()
    with PlaceMap.open(tmp_path / "site.fsmap", read_only=True) as site:
        assert len(site) == 4 and site.check() == [] and site.sessions[0].parts == (0,)
