# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""benchmarks/real counts revisits and wrong loops as its page says."""

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from benchmarks.accuracy.loop_peers import as_run
from benchmarks.accuracy.markdown import table
from benchmarks.real import __main__ as real
from benchmarks.real.protocol import count_right, find_revisits, judge
from benchmarks.real.recordings import Rule, fill_columns
from fusionslam import Cloud
from fusionslam.base.arrays import Floats, Integers
from fusionslam.evaluation import VerifiedRun

SECONDS = 10**9
STAMPS = np.arange(9) * 10 * SECONDS


def out_and_back() -> Floats:
    """Five steps of 2 m along x, and back by the same places, turned round; 10 s a step."""
    poses = np.tile(np.eye(4), (9, 1, 1))
    poses[:, 0, 3] = [0, 2, 4, 6, 8, 6, 4, 2, 0]
    poses[5:, :3, :3] = Rotation.from_euler("z", 180, degrees=True).as_matrix()
    return poses


def looped() -> tuple[Floats, Integers, Floats]:
    """The poses of ``out_and_back``, the frame that each one comes back to, and its right pose."""
    poses = out_and_back()
    match = np.array([-1, -1, -1, -1, -1, 3, 2, 1, 0])
    estimates = np.full(poses.shape, np.nan)
    estimates[5:] = np.linalg.inv(poses[match[5:]]) @ poses[5:]
    return poses, match, estimates


def test_a_revisit_is_near_a_frame_that_is_old_enough() -> None:
    poses = out_and_back()

    def rows(rule: Rule) -> list[int]:
        return np.flatnonzero(find_revisits(poses, STAMPS, rule)).tolist()

    assert rows(Rule(1.0)) == [5, 6, 7, 8]
    assert rows(Rule(1.0, seconds=20.0)) == [6, 7, 8]  # 5 is exactly 20 s after 3
    assert rows(Rule(1.0, frames=4)) == [7, 8]  # 6 is exactly four frames after 2
    assert rows(Rule(2.0, seconds=20.0)) == [6, 7, 8]  # neighbours are exactly 2 m apart
    assert rows(Rule(2.1, seconds=20.0)) == [5, 6, 7, 8]  # 5 is 2 m from 2
    assert rows(Rule(1.0, degrees=45.0)) == []


def run_of(poses: Floats, match: Integers, estimates: Floats, **found: Any) -> VerifiedRun:
    """What a detector says of the frames of ``looped``."""
    clouds = [Cloud(np.zeros((1, 3), np.float32))] * len(poses)
    seen = {"stamps_ns": STAMPS, "match": match, "match_from_query": estimates}
    return as_run("made", clouds, poses, **seen, **found)


def test_loops_are_right_or_wrong_by_the_true_poses() -> None:
    poses, match, estimates = looped()
    estimates[6, 1, 3] += 0.9
    estimates[7, 1, 3] += 1.1
    estimates[8, :3, :3] = Rotation.from_euler("z", 187, degrees=True).as_matrix()
    run = run_of(
        poses,
        match,
        estimates,
        probability=np.array([0, 0, 0, 0, 0, 0.99, 0.5, 0.6, 0.7]),
        accepted=np.array([False] * 5 + [True, True, True, False]),
        seconds=np.full(9, 0.002),
    )
    found = judge(run, Rule(1.0))
    assert (found.frames, found.revisits, found.accepted, found.wrong) == (9, 4, 3, 1)
    assert found.recall == 2 / 4  # 5 and 6; 8 is right, but was not accepted
    assert found.full == 2 / 4  # 5 and 8 are more probable than 7, which is wrong
    assert found.metres == pytest.approx([0, 0.9, 1.1], abs=1e-6)
    assert found.cells()[-3:] == ["0.900", "1.080", "2"]  # median, 95 %, milliseconds


def test_poses_are_counted_by_the_probability_that_was_stated(tmp_path: Path) -> None:
    poses, match, estimates = looped()
    estimates[7, 1, 3] += 1.1
    run = run_of(
        poses,
        match,
        estimates,
        probability=np.array([0, 0, 0, 0, 0, 1.0, 0.995, 0.991, 0.5]),
        accepted=np.zeros(9, np.bool_),
        seconds=np.zeros(9),
    )
    cells = count_right(run)
    assert cells == ["-", "-", "1.00 (1)", "-", "-", "-", "0.67 (3)"]
    real.draw_reliability([["hku_1", *cells], ["hku_2", *cells]], tmp_path / "drawn.png")
    assert (tmp_path / "drawn.png").stat().st_size > 1000


def test_without_revisits_each_loop_is_wrong() -> None:
    poses = out_and_back()[:5]
    estimates = np.full((5, 4, 4), np.nan)
    estimates[4] = np.eye(4)
    run = as_run(
        "made",
        [Cloud(np.zeros((1, 3), np.float32))] * 5,
        poses,
        match=np.array([-1, -1, -1, -1, 1]),
        match_from_query=estimates,
        probability=np.array([0, 0, 0, 0, 0.9]),
        accepted=np.arange(5) == 4,
        seconds=np.zeros(5),
    )
    found = judge(run, Rule(1.0))
    assert (found.revisits, found.accepted, found.wrong) == (0, 1, 1)
    assert found.recall is found.full is None
    assert found.cells()[2:4] == ["-", "-"]


def test_columns_from_above_are_filled_from_the_ground() -> None:
    counts = np.zeros((131, 131), np.uint8)
    counts[64, 65] = 1  # 75 - 74 + 0.5 cells ahead, 75 - 75 + 0.5 to the left
    counts[65, 65] = 2
    points = fill_columns(counts).points
    expected = [[0.6, 0.2, -1.53], [0.2, 0.2, -1.53], [0.2, 0.2, -1.13]]
    np.testing.assert_allclose(sorted(points.tolist()), sorted(expected), atol=1e-6)


def test_a_recording_that_is_not_there_is_skipped_with_a_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    given = ["real", "hku_1", "redkitchen", "--without-peers", "--data", str(tmp_path)]
    monkeypatch.setattr(sys, "argv", given)
    real.main()
    out, err = capsys.readouterr()
    assert not out
    assert [line.split(",")[0] for line in err.splitlines()] == [
        "without hku_1",
        "without redkitchen",
    ]
    assert str(tmp_path) in err


def test_rows_of_recordings_that_were_not_measured_stay(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    page = tmp_path / "page.md"
    head = ["recording", "found by", "figure"]
    known = [["hku_1", "ours", "1"], ["hku_1", "a peer", "2"], ["euroc_v101", "ours", "3"]]
    page.write_text(f"<!-- loops: -->\n{table(head, known)}\n<!-- end -->\n")
    monkeypatch.setattr(real, "PAGE", page)
    measured = [["redkitchen", "ours", "4"], ["hku_1", "ours", "5"]]
    assert real.with_other_rows("loops", measured) == [
        ["hku_1", "ours", "5"],
        ["hku_1", "a peer", "2"],
        ["redkitchen", "ours", "4"],
        ["euroc_v101", "ours", "3"],
    ]


def test_the_headline_has_the_longest_local_maps_of_a_peer() -> None:
    def row(by: str, recall: str, accepted: str, wrong: str) -> list[str]:
        return ["hku_1", by, "314", "40", recall, "0.5", accepted, wrong, "-", "-", "1"]

    rows = [
        row("fusionslam", "0.375", "32", "0"),
        row("MapClosures, local maps of 10", "0.275", "14", "2"),
        row("MapClosures, local maps of 60", "0.725", "43", "3"),
        row("Scan Context, without proof", "-", "-", "-"),
        ["kitti00_keyframes", "fusionslam", "152", "0", "-", "-", "0", "0", "-", "-", "1"],
    ]
    lines = [line.strip("| ").split(" | ") for line in real.headline(rows).splitlines()]
    assert lines[2:] == [
        ["hku_1", "40", "0.375; 0 of 32 wrong", "0.725; 3 of 43 wrong", "-"],
        ["kitti00_keyframes", "0", "0 of 0 wrong", "-", "-"],
    ]
