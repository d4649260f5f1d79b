# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Maps are corrected by hand: what a person decided stays, and can be taken back."""

import getpass
import sqlite3
from collections.abc import Callable
from contextlib import closing
from datetime import UTC, datetime
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fusionslam import ConfigError, PoseGraph
from fusionslam.base.arrays import Floats
from fusionslam.errors import FusionSlamError
from fusionslam.geometry.globe import MapOrigin, geographic
from fusionslam.mapping.edge import Edge
from fusionslam.mapping.fixes import add_fixes
from fusionslam.mapping.map_file import MapFile
from fusionslam.mapping.place_map import PlaceMap
from fusionslam.registration.result import Refusal
from fusionslam.sensors.messages import Fix
from map_fixtures import STORED, build
from refusals import refuses
from rows import rows
from streets import RETURN, WAY, at, error, frames

pytest.importorskip("gtsam", reason="the library of pose graphs is an extra")

TRUTH = [np.linalg.inv(WAY[0]) @ pose for pose in WAY]
TUESDAY = frames(RETURN, 200, day=1)
WRONG = np.eye(4)
"""Pose of keyframe 8 in the frame of keyframe 2, 36 m behind it."""


def stored(path: Path, *tables: str) -> list[tuple[Any, ...]]:
    """Rows of tables as they are in the file, to the bit."""
    with closing(sqlite3.connect(f"file:{path}?mode=ro", uri=True)) as database:
        return [row for table in tables for row in database.execute(f"SELECT * FROM {table}")]


def test_a_wrong_link_is_refused_with_the_number_and_changes_nothing(path: Path) -> None:
    before = stored(path, "edge", "solution", "setting")
    with PlaceMap.open(path) as site:
        seen = site.corrections.link(0, 8)  # 48 m apart
        assert seen.state == "refused" and seen.reason is not None
        assert seen.reason.code == "far" and seen.reason.number > 9
        given = site.corrections.link(2, 8, WRONG)
        assert given.state == "refused" and given.reason is not None
        assert given.reason.code == "contradicts-odometry" and given.reason.number > 4.5
        moved = site.corrections.fix(8, at(-40, 0, 0, 0))
        assert moved.state == "refused" and moved.reason is not None
        assert [*site.corrections] == []
    assert stored(path, "edge", "solution", "setting") == before


@pytest.mark.slow
def test_a_forced_link_is_kept_and_marked_whatever_comes_later(path: Path) -> None:
    with PlaceMap.open(path) as site:
        edge = site.corrections.link(2, 8, WRONG, force=True, why="a trial")
        assert edge.state == "believed" and edge.reason is not None
    with PlaceMap.open(path, "tuesday") as site:
        for frame in TUESDAY[:2]:
            site.add(frame)
        site.solve()
        (kept,) = (each for each in site.loops if {each.a, each.b} == {2, 8})
        assert kept.state == "believed" and kept.reason == edge.reason
        assert kept.reason.code == "forced" and kept.reason.number > 4.5
        assert error(site.trajectory("monday")[1], WAY) > 1.0
        (correction,) = site.corrections
        assert (correction.action, correction.a, correction.b) == ("link", 2, 8)
        assert (correction.who, correction.why) == (getpass.getuser(), "a trial")
        age = datetime.now(UTC) - datetime.fromisoformat(correction.when)
        assert abs(age.total_seconds()) < 3600


def test_a_loop_that_was_taken_out_is_put_in_again_by_its_clouds(path: Path) -> None:
    with PlaceMap.open(path) as site:
        (gone,) = site.corrections.unlink(10, 6)
        edge = site.corrections.link(6, 10)
        assert edge.reason is not None and (edge.state, edge.reason.code) == ("believed", "linked")
        assert edge.reason.number > 0.9
        off = edge.pose - np.linalg.inv(TRUTH[6]) @ TRUTH[10]
        assert np.linalg.norm(off[:3, 3]) < 0.05
        assert {each.state for each in site.edges if each.number == gone.number} == {"refused"}


def test_corrections_leave_a_map_where_satellites_have_it(path: Path) -> None:
    """Fixes are those of the true way from a place that is known."""
    pytest.importorskip("pyproj", reason="positions on the globe are an extra")
    true = MapOrigin(latitude=49, longitude=8.4, altitude=100, heading=30)
    places = geographic(np.array(TRUTH)[:, :3, 3], true)[:, [1, 0, 2]]
    with PlaceMap.open(path) as site:
        stamps = site.trajectory("monday")[0].tolist()
        fixes = [
            Fix(stamp_ns=stamp_ns, frame_id="gps", position=place, covariance=np.eye(3) * 1e-2)
            for stamp_ns, place in zip(stamps, places, strict=True)
        ]
        add_fixes(site, "monday", fixes, np.eye(4))
        placed, before = site.content.origin, stored(path, "edge", "solution")
        assert placed is not None and abs(placed.latitude - 49) < 1e-6
        site.corrections.unlink(10, 6)
        moved = site.content.origin
        assert moved is not None and abs(moved.latitude - 49) < 1e-6
        site.corrections.undo()
        assert site.content.origin == placed and stored(path, "edge", "solution") == before


@pytest.mark.slow
def test_without_loops_a_map_keeps_odometry(path: Path) -> None:
    with PlaceMap.open(path) as site:
        for edge in site.loops:
            site.corrections.unlink(edge.a, edge.b)
        site.solve()  # which asks refused loops again
        assert {(e.state, e.reason and e.reason.code) for e in site.loops} == {
            ("refused", "unlinked")
        }
        alone = PoseGraph()
        for _ in TRUTH:
            alone.add_node()
        for edge in site.edges:
            if edge.b - edge.a == 1:
                alone.add_edge(edge.a, edge.b, edge.pose, edge.covariance, edge.kind)
        found = site.trajectory("monday")[1]
        np.testing.assert_allclose(found, alone.solve().poses, rtol=0, atol=1e-6)


@pytest.mark.slow
@rows("metres", (0.2, 0.05, 0.01))
def test_a_keyframe_that_is_held_is_within_the_deviation_that_was_stated(
    path: Path, tmp_path: Path, metres: float
) -> None:
    own = tmp_path / "site.fsmap"
    own.write_bytes(path.read_bytes())
    with PlaceMap.open(own) as site:
        before = site.trajectory("monday")[1][8]
        place = before.copy()
        place[:3, 3] += [0.1, 0.3, 0.0]
        edge = site.corrections.fix(8, place, metres=metres, degrees=5)
        assert edge.state == "believed" and edge.reason is not None
        assert edge.reason.code == "fixed"
    with PlaceMap.open(own, read_only=True) as site:
        poses = site.trajectory("monday")[1]
        assert np.linalg.norm((poses[8] - place)[:3, 3]) <= metres
        np.testing.assert_allclose(poses[0], np.eye(4), atol=1e-6)


@pytest.mark.slow
def test_undo_restores_the_bytes_of_the_solution(path: Path) -> None:
    states = [stored(path, "edge", "solution")]
    with PlaceMap.open(path) as site:
        steps: list[Callable[[], object]] = [
            lambda: site.corrections.unlink(6, 10),
            lambda: site.corrections.link(6, 10),
            lambda: site.corrections.link(2, 8, WRONG, force=True),
            lambda: site.corrections.fix(8, TRUTH[8], metres=0.01, force=True),
        ]
        for step in steps:
            step()
            states.append(stored(path, "edge", "solution"))
        assert all(one != other for one, other in pairwise(states))
        for number in (4, 3, 2, 1):
            states.pop()
            assert site.corrections.undo(why="a trial").number == number
            assert stored(path, "edge", "solution") == states[-1]
        with refuses("no-correction"):
            site.corrections.undo()
        assert [each.undone for each in site.corrections][4:] == [4, 3, 2, 1]
    with PlaceMap.open(path) as site:
        site.corrections.unlink(5, 12)
        assert site.corrections.undo().a == 5
    assert stored(path, "edge", "solution") == states[-1]


@pytest.mark.slow
def test_a_correction_is_taken_back_after_the_map_has_grown(path: Path) -> None:
    with PlaceMap.open(path, "tuesday") as site:
        site.corrections.unlink(6, 10)
        site.corrections.link(2, 8, WRONG, force=True)
        for frame in TUESDAY[:2]:
            site.add(frame)
        site.corrections.undo()
        site.corrections.undo()
        assert len(site) == len(WAY) + 2
        assert not any(each.is_by_hand for each in site.edges)
        assert {each.state for each in site.loops if {each.a, each.b} == {6, 10}} == {"believed"}
        assert error(site.trajectory("monday")[1], WAY) < 0.05


@pytest.mark.slow
def test_one_link_by_hand_joins_parts_and_goes_with_a_session(short: Path) -> None:
    elsewhere = frames(WAY[:3], 50, day=1, place=40)
    build(short, elsewhere, "tuesday")
    move = at(30, 5, 90, 0)
    with PlaceMap.open(short) as site:
        site.corrections.unlink(0, 1, why="kept")
        alone = site.trajectory("tuesday")[1]
        assert [each.parts for each in site.sessions] == [(0,), (STORED,)]
        edge = site.corrections.link(0, STORED, move)
        assert edge.kind == "merge" and edge.state == "believed"
        assert [each.parts for each in site.sessions] == [(0,), (0,)]
        joined = site.trajectory("tuesday")[1]
        np.testing.assert_allclose(joined, move @ np.linalg.inv(alone[0]) @ alone, atol=1e-3)
        site.forget("tuesday")
        (kept,) = site.corrections
        assert kept.why == "kept"
        site.corrections.undo()
        assert {each.state for each in site.edges} == {"believed"}


@pytest.mark.slow
def test_corrections_of_a_map_go_with_it_into_another_one(path: Path, tmp_path: Path) -> None:
    other = tmp_path / "other.fsmap"
    build(other, TUESDAY[:5], "tuesday")
    with PlaceMap.open(other) as second:
        second.corrections.fix(3, second.trajectory("tuesday")[1][3], metres=0.05)
        second.corrections.unlink(1, 2)
    with PlaceMap.open(path) as site:
        site.corrections.unlink(6, 10)
        assert site.merge(other).reason is None
        first = len(WAY)
        made = [(each.number, each.action, each.a, each.b) for each in site.corrections]
        assert made[1:] == [(2, "fix", first, first + 3), (3, "unlink", first + 1, first + 2)]
        by_hand = {(e.a, e.b): e.state for e in site.edges if e.is_by_hand}
        assert by_hand == {
            (6, 10): "refused",
            (first, first + 3): "believed",
            (first + 1, first + 2): "refused",
        }
        site.corrections.undo()
        site.corrections.undo()
        assert [(e.a, e.b) for e in site.edges if e.is_by_hand] == [(6, 10)]
        site.forget("tuesday")
        assert [each.action for each in site.corrections] == ["unlink"]


def skewed() -> Floats:
    pose = np.eye(4)
    pose[0, 1] = 0.5
    return pose


@rows(
    "code, kind, correct",
    (
        ("unknown-keyframe", FusionSlamError, lambda made: made.link(0, 4)),
        ("unknown-keyframe", FusionSlamError, lambda made: made.unlink(-1, 2)),
        ("unknown-keyframe", FusionSlamError, lambda made: made.fix("2", np.eye(4))),
        ("same-keyframe", FusionSlamError, lambda made: made.link(2, 2)),
        ("already-linked", FusionSlamError, lambda made: made.link(0, 1)),
        ("not-a-rotation", FusionSlamError, lambda made: made.link(0, 2, skewed())),
        ("not-a-rotation", FusionSlamError, lambda made: made.fix(2, skewed())),
        ("not-finite", FusionSlamError, lambda made: made.fix(2, np.full((4, 4), np.nan))),
        ("out-of-range", ConfigError, lambda made: made.fix(2, np.eye(4), metres=0)),
        ("out-of-range", ConfigError, lambda made: made.link(0, 2, np.eye(4), degrees=np.nan)),
        ("no-loop", FusionSlamError, lambda made: made.unlink(0, 2)),
        ("origin", FusionSlamError, lambda made: made.fix(0, np.eye(4))),
        ("why", ConfigError, lambda made: made.unlink(0, 1, why="a\x1b[2J")),
        ("no-correction", FusionSlamError, lambda made: made.undo()),
    ),
)
def test_what_cannot_be_corrected_is_named(
    short: Path, code: str, kind: type[FusionSlamError], correct: Callable[[Any], object]
) -> None:
    before = stored(short, "edge", "solution", "setting")
    with PlaceMap.open(short) as site, refuses(code, error=kind):
        correct(site.corrections)
    assert stored(short, "edge", "solution", "setting") == before


def test_a_map_that_is_read_or_written_elsewhere_is_not_corrected(short: Path) -> None:
    with PlaceMap.open(short) as site:
        with refuses("locked"):
            PlaceMap.open(short)
        site.corrections.unlink(0, 1)
    with PlaceMap.open(short, read_only=True) as reader:
        assert len([*reader.corrections]) == 1
        with refuses("read-only", error=ConfigError):
            reader.corrections.undo()


def test_a_correction_that_cannot_be_written_changes_nothing(
    short: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = stored(short, "edge", "solution", "setting")
    with PlaceMap.open(short) as site:
        states = [each.state for each in site.edges]

        def fail(*_: object) -> None:
            raise OSError("the disk is full")

        with monkeypatch.context() as patch, pytest.raises(OSError, match="full"):
            patch.setattr(MapFile, "store_setting", fail)
            site.corrections.unlink(0, 1)
        assert [each.state for each in site.edges] == states
        assert site.check() == []
    assert stored(short, "edge", "solution", "setting") == before


def test_senseless_corrections_are_damage(short: Path) -> None:
    with PlaceMap.open(short) as site:
        with site.file.transaction():
            site.file.store_setting("correction 1", {"action": "link", "a": 0})
        with refuses("damaged"):
            list(site.corrections)
        with site.file.transaction():
            site.file.delete_setting("correction 1")
        site.corrections.link(0, 2, site.trajectory("monday")[1][2])
        (record,) = site.file.numbered_settings("correction").values()
        record["edges"] = [[0, "surely", None, None, None]]
        record.pop("before")
        with site.file.transaction():
            site.file.store_setting("correction 1", record)
        with refuses("damaged"):
            site.corrections.undo()
        assert site.check() == []


def test_a_graph_never_believes_an_edge_that_a_person_took_out() -> None:
    graph, spread = PoseGraph(), np.diag([0.1] * 3 + [0.02] * 3) ** 2
    for _ in range(3):
        graph.add_node()
    step = at(2, 0, 0, 0)
    for node in (1, 2):
        graph.add_edge(node - 1, node, step, spread, "odometry")
    reason = Refusal("unlinked", 0, "taken out by hand")
    graph.add_edge(0, 2, step @ step, spread, "loop", reason)  # which would fit
    held = Refusal("forced", 1, "forced by hand")
    graph.add_edge(0, 2, at(90, 0, 0, 0), spread / 1e4, "loop", held)

    def states() -> list[tuple[str, Refusal | None]]:
        loops: tuple[Edge, ...] = tuple(e for e in graph.edges if e.kind == "loop")
        return [(each.state, each.reason) for each in loops]

    expected = [("refused", reason), ("believed", held)]
    graph.update()
    assert states() == expected
    solution = graph.solve()
    assert states() == expected
    assert abs(solution.poses[2, 0, 3] - 90) < 0.1
