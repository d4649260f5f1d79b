# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The reference run of OpenRatSLAM's pose cells and experience map, step by step."""

import csv
import gzip
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from fusionslam.ratslam import Action, ExperienceMap, PoseCells

Run = tuple[NDArray[Any], list[Action], NDArray[np.float64], ExperienceMap]


def table(path: Path) -> NDArray[Any]:
    with gzip.open(path, "rt") as file:
        return np.genfromtxt(file, delimiter=",", names=True)


@pytest.fixture(scope="module")
def cells_at(ratslam_reference: Path) -> dict[int, NDArray[np.float64]]:
    with gzip.open(ratslam_reference / "pc_cells.csv.gz", "rt") as file:
        return {int(row[0]): np.array(row[1:], np.float64) for row in csv.reader(file)}


@pytest.fixture(scope="module")
def run(ratslam_reference: Path, cells_at: dict[int, NDArray[np.float64]]) -> Run:
    cells = PoseCells(preset="openratslam")
    graph = ExperienceMap(preset="openratslam", initial_heading=np.radians(140))
    expected, actions, decoded = table(ratslam_reference / "pc_output.csv.gz"), [], []
    for step, row in enumerate(table(ratslam_reference / "pc_input.csv.gz")):
        cells.on_view(int(row["vt_id"]), row["vt_rad"])
        cells.on_odometry(row["vtrans"], row["vrot"], row["dt"])
        action = cells.action()
        graph.on_odometry(row["vtrans"], row["vrot"], row["dt"])
        graph.apply(action)
        if action.kind:
            graph.relax()
        if step in cells_at:
            np.testing.assert_allclose(cells.activity.ravel(), cells_at[step], rtol=0, atol=1e-9)
        actions.append(action)
        decoded.append(cells.best)
    return expected, actions, np.array(decoded), graph


def test_every_action_is_the_references(run: Run) -> None:
    expected, actions, _, _ = run
    assert len(actions) == 3840
    found = [(a.kind, a.source, a.target) if a.kind else (0, 0, 0) for a in actions]
    kinds = expected["action"] > 0
    wanted = np.stack([expected[name] * kinds for name in ("action", "src_exp", "dest_exp")], 1)
    np.testing.assert_array_equal(np.array(found), wanted)


def test_every_decoded_pose_is_the_references(run: Run) -> None:
    expected, _, decoded, _ = run
    wanted = np.stack([expected[f"best_{axis}"] for axis in ("x", "y", "th")], 1)
    period = np.array([20, 20, 36])
    error = (decoded - wanted + period / 2) % period - period / 2
    assert np.abs(error).max() < 1e-9


def test_the_map_is_the_references(run: Run, ratslam_reference: Path) -> None:
    graph = run[3]
    wanted = json.loads((ratslam_reference / "em_output.json").read_text())
    assert (len(graph.nodes), len(graph.links)) == (136, 136)
    nodes = np.array([[node[name] for name in ("x", "y", "th")] for node in wanted["nodes"]])
    np.testing.assert_allclose(graph.nodes, nodes, rtol=0, atol=1e-9)
    for ours, theirs in (
        ("source", "from"),
        ("target", "to"),
        ("distance", "d"),
        ("heading", "heading_rad"),
        ("facing", "facing_rad"),
        ("duration", "delta_time_s"),
    ):
        given = [link[theirs] for link in wanted["links"]]
        np.testing.assert_allclose(graph.links[ours], given, rtol=0, atol=1e-9)
