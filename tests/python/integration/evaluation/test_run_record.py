# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What a run of RatSLAM stores."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fusionslam.errors import DataError, ShapeError
from fusionslam.evaluation.maps.run import LINK, REFUSED, RatSlamRun
from maps import square_run
from rows import rows


def record(**changes: Any) -> RatSlamRun:
    """Three steps, the middle one a view; two nodes."""
    values: dict[str, Any] = {
        "name": "a drive",
        "views": "alignment",
        "odometry": "truth",
        "preset": "robust",
        "config": {"gap_s": 1.0},
        "stamps_ns": np.array([0, 5, 5], np.int64),
        "is_view": np.array([False, True, False]),
        "view_ids": np.array([-1, 0, -1], np.int64),
        "poses": np.arange(9.0).reshape(3, 3),
        "dead_reckoning": np.arange(9.0).reshape(3, 3),
        "node_ids": np.array([-1, 0, 1], np.int64),
        "offsets": np.array([[1.0, 2.0, 3.0], [0.5, 0.0, 0.1], [0.0, 2.0, 3.0]]),
        "actions": np.array([[0, 0, 0], [1, 0, 0], [1, 0, 1]], np.int64),
        "cells": np.ones((3, 3)),
        "step_seconds": np.zeros((3, 3)),
        "truth": None,
        "why": ["view 0 is new"],
        "notes": ["a gap"],
        "nodes": np.array([[1.0, 1.0, np.pi / 2], [4.0, 4.0, 1.0]]),
        "node_stamps_ns": np.array([5, 5], np.int64),
        "node_views": np.array([0, 0], np.int64),
        "links": np.array([(0, 1, 3.0, 0.1, 0.2, 1.0, 0.1, 0.1)], LINK),
        "refused": np.array([(5, 1, 0, 3.0, 0.1, 1.0, 0.2)], REFUSED),
        "activity_th": np.ones((1, 36), np.float32),
        "activity_x": np.ones((1, 20), np.float32),
        "activity_y": np.ones((1, 20), np.float32),
    }
    return RatSlamRun(**(values | changes))


def test_a_stored_run_comes_back_the_same(tmp_path: Path) -> None:
    run = record(truth=np.arange(9.0).reshape(3, 3))
    run.save(tmp_path / "run.npz")
    again = RatSlamRun.load(tmp_path / "run.npz")
    for name, value in vars(run).items():
        found = getattr(again, name)
        if isinstance(value, np.ndarray):
            assert found.dtype == value.dtype
            np.testing.assert_array_equal(found, value)
        else:
            assert found == value


def test_a_run_without_truth_comes_back_without(tmp_path: Path) -> None:
    record().save(tmp_path / "run.npz")
    assert RatSlamRun.load(tmp_path / "run.npz").truth is None


def test_the_same_run_gives_the_same_bytes(tmp_path: Path) -> None:
    for name in ("a", "b"):
        record().save(tmp_path / name)
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


def test_final_poses_are_seen_from_their_nodes() -> None:
    first, second, third = record().final_poses
    np.testing.assert_allclose(first, [1, 2, 3])
    np.testing.assert_allclose(second, [1, 1.5, np.pi / 2 + 0.1])
    assert third[2] == pytest.approx(4 - 2 * np.pi)


@rows(
    "name, wrong",
    [
        ("poses", np.zeros((2, 3))),
        ("view_ids", np.zeros(3)),
        ("truth", np.zeros((3, 2))),
        ("node_views", np.zeros(3, np.int64)),
        ("links", np.zeros((1, 6))),
        ("activity_x", np.ones((2, 20), np.float32)),
        ("why", []),
    ],
)
def test_arrays_that_do_not_fit_are_named(name: str, wrong: Any) -> None:
    with pytest.raises(ShapeError, match=name):
        record(**{name: wrong})


def test_a_node_that_is_not_there_is_named() -> None:
    with pytest.raises(DataError, match="node 2"):
        record(node_ids=np.array([-1, 0, 2], np.int64))
    links = record().links.copy()
    links["source"][0] = -1
    with pytest.raises(DataError, match="node -1"):
        record(links=links)


def test_another_version_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "run.npz"
    record().save(path)
    with np.load(path) as stored:
        arrays = dict(stored)
    about = json.loads(str(arrays.pop("about"))) | {"format": "fusionslam.ratslam_run.99"}
    np.savez(path, about=np.array(json.dumps(about)), **arrays)
    with pytest.raises(DataError, match=r"run\.npz.*ratslam_run\.99"):
        RatSlamRun.load(path)


@rows("share", [0.0, 0.3, 0.7, 0.99])
def test_a_run_that_is_cut_short_is_refused(tmp_path: Path, share: float) -> None:
    path = tmp_path / "run.npz"
    record().save(path)
    whole = path.read_bytes()
    path.write_bytes(whole[: int(share * len(whole))])
    with pytest.raises(DataError, match=r"run\.npz"):
        RatSlamRun.load(path)


def test_a_missing_run_is_named(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"none\.npz"):
        RatSlamRun.load(tmp_path / "none.npz")


def test_a_run_is_a_value() -> None:
    assert replace(record(), name="another").name == "another"


def test_a_run_is_shown_in_a_line() -> None:
    assert repr(square_run()) == "<RatSlamRun by hand: 8 steps, 4 nodes, 4 links>"
