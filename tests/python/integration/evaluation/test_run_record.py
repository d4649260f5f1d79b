# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What a run of RatSLAM stores."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fusionslam.errors import DataError, ShapeError
from fusionslam.evaluation.maps.run import RatSlamRun
from maps import little_run, square_run
from rows import rows
from stored import change_archive


def record(**changes: Any) -> RatSlamRun:
    """Three steps, the middle one a view; two nodes."""
    given: dict[str, Any] = {
        "is_view": np.array([False, True, False]),
        "view_ids": np.array([-1, 0, -1]),
        "poses": np.arange(9.0).reshape(3, 3),
        "dead_reckoning": np.arange(9.0, 18.0).reshape(3, 3),
        "cells": np.ones((3, 3)),
        "offsets": np.array([[1.0, 2.0, 3.0], [0.5, 0.0, 0.1], [0.0, 2.0, 3.0]]),
        "refused": [(30.0, 1, 0)],
        "why": ["view 0 is new"],
        "notes": ["a gap"],
        "config": {"gap_s": 1.0},
        "activity_th": np.ones((1, 36), np.float32),
        "activity_x": np.ones((1, 20), np.float32),
        "activity_y": np.ones((1, 20), np.float32),
    }
    nodes = [(1.0, 1.0, np.pi / 2), (4.0, 4.0, 1.0)]
    run = little_run(None, [(0, 0, 0), (1, 0, 0), (1, 0, 1)], nodes, [(0, 1)], **given)
    return replace(run, **changes)


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


def test_the_same_run_gives_the_same_bytes_and_no_truth_stays_none(tmp_path: Path) -> None:
    for name in ("a", "b"):
        record().save(tmp_path / name)
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()
    assert RatSlamRun.load(tmp_path / "a").truth is None


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


def test_damaged_missing_and_other_files_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "run.npz"
    with pytest.raises(DataError, match=r"run\.npz"):
        RatSlamRun.load(path)
    record().save(path)
    whole = path.read_bytes()
    for share in (0.0, 0.3, 0.7, 0.99):
        path.write_bytes(whole[: int(share * len(whole))])
        with pytest.raises(DataError, match=r"run\.npz"):
            RatSlamRun.load(path)
    path.write_bytes(whole)
    change_archive(path, lambda about, _: about.update(format="fusionslam.ratslam_run.99"))
    with pytest.raises(DataError, match=r"run\.npz.*ratslam_run\.99"):
        RatSlamRun.load(path)


def test_a_run_is_a_value_that_is_shown_in_a_line() -> None:
    assert replace(record(), name="another").name == "another"
    assert repr(square_run()) == "<RatSlamRun by hand: 8 steps, 4 nodes, 4 links>"
