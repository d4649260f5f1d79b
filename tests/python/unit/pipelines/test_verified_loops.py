# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The loops of a recording that are proven: their files, and what is said of them."""

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fusionslam.evaluation import VerifiedRun
from fusionslam.pipelines.verified_loops import describe_loops, write_g2o, write_loops
from verified import verified_run

WINDOW = {"loop_closure": {"window": 2}}


@pytest.fixture
def run() -> VerifiedRun:
    """Three accepted loops with poses in space and full covariances."""
    rng, poses = np.random.default_rng(3), np.array(verified_run().match_from_query)
    covariance = np.array(verified_run().covariance)
    for row in (4, 5, 8):
        poses[row, :3, :3] = Rotation.from_rotvec(rng.normal(0, 1, 3)).as_matrix()
        poses[row, :3, 3] = rng.normal(0, 3, 3)
        half = rng.normal(0, 0.1, (6, 6))
        covariance[row] = half @ half.T + 0.01 * np.eye(6)
    return verified_run(match_from_query=poses, covariance=covariance, config=WINDOW)


def test_a_line_of_loops_csv_is_the_query_in_the_match(run: VerifiedRun, tmp_path: Path) -> None:
    write_loops(run, tmp_path / "loops.csv")
    rows = list(csv.DictReader((tmp_path / "loops.csv").open()))
    pairs = [(row["query"], row["match"]) for row in rows]
    assert pairs == [("40", "20"), ("50", "10"), ("80", "30")]  # numbers, not rows
    for row, query in zip(rows, (4, 5, 8), strict=True):
        number = {key: float(row[key]) for key in row}
        pose = np.eye(4)
        pose[:3, 3] = [number[axis] for axis in "xyz"]
        x, y, z, w = (number[f"q{axis}"] for axis in "xyzw")
        # The rotation matrix of a unit quaternion, written out.
        pose[:3, :3] = [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
        assert np.allclose(pose, run.match_from_query[query], atol=1e-7)
        assert int(row["query_stamp_ns"]) == run.stamps_ns[query]
        assert int(row["match_stamp_ns"]) == run.stamps_ns[run.match[query]]
        assert number["overlap"] == run.overlap[query]
        assert number["probability"] == run.probability[query]
    assert rows[1]["distance"] == "inf"  # proposed by another descriptor


def test_an_edge_of_loops_g2o_weighs_errors_of_its_pose_as_the_covariance_does(
    run: VerifiedRun, tmp_path: Path
) -> None:
    write_g2o(run, tmp_path / "loops.g2o")
    edges = [line.split() for line in (tmp_path / "loops.g2o").read_text().splitlines()]
    assert [edge[:3] for edge in edges] == [
        ["EDGE_SE3:QUAT", "20", "40"], ["EDGE_SE3:QUAT", "10", "50"], ["EDGE_SE3:QUAT", "30", "80"]
    ]  # fmt: skip
    rng = np.random.default_rng(4)
    for edge, query in zip(edges, (4, 5, 8), strict=True):
        values = np.array(edge[3:], float)
        assert len(values) == 7 + 21
        pose = np.eye(4)
        pose[:3, 3], pose[:3, :3] = values[:3], Rotation.from_quat(values[3:7]).as_matrix()
        assert np.allclose(pose, run.match_from_query[query], atol=1e-7)
        information = np.zeros((6, 6))
        information[np.triu_indices(6)] = values[7:]
        information += np.triu(information, 1).T
        error = rng.normal(0, 1e-4, 6)  # metres, then radians
        # g2o's error: translation and vector of the quaternion of measurement^-1 * estimate.
        vector = Rotation.from_rotvec(error[3:]).as_quat()[:3]
        measured = np.concatenate([error[:3], vector])
        expected = error @ np.linalg.solve(run.covariance[query], error)
        assert measured @ information @ measured == pytest.approx(expected, rel=1e-5)


def test_it_is_said_how_many_loops_were_proven_and_why_not_more(run: VerifiedRun) -> None:
    long = run.only(np.arange(9))
    text = describe_loops(long)
    assert text.startswith("3 loops proven in 9 frames: 4 without candidates, 2 refused")
    assert "1 tilted" in text and "too few frames for loops, 9" in text


def test_advice_is_given_where_nothing_could_be_or_is_found(run: VerifiedRun) -> None:
    nothing = replace(run, accepted=np.zeros(9, np.bool_))
    assert "nothing comes back, or m2dp+scan_context cannot tell" in describe_loops(nothing)
    alone = np.full((9, 3), -1)
    short = replace(
        verified_run(config={"loop_closure": {"window": 50}}),
        accepted=np.zeros(9, np.bool_),
        candidates=alone,
        rejected=run.rejected[:0],
    )
    assert "too few frames" in describe_loops(short)
