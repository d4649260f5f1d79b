# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The map of the reference run by both presets, with its odometry and with twice its errors.

Odometry with twice the errors: what it said, plus once more what it said beyond the true motion,
which the true poses give.
"""

import gzip
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fusionslam.ratslam import Action, ActionKind, ExperienceMap, PoseCells
from ratslam_drives import rmse


def table(path: Path) -> Any:
    with gzip.open(path, "rt") as file:
        return np.genfromtxt(file, delimiter=",", names=True)


class Reference:
    """The input and the truth of the run."""

    def __init__(self, folder: Path) -> None:
        self.rows = table(folder / "pc_input.csv.gz")
        truth = table(folder / "pc_groundtruth.csv.gz")
        self.truth = np.stack([truth[name] for name in ("x", "y", "th")], axis=1)

    def odometry(self, errors: float) -> Any:
        """float64 (n, 2): speed and turn rate with so many times their errors."""
        said = np.stack([self.rows["vtrans"], self.rows["vrot"]], axis=1)
        steps, dt = np.diff(self.truth, axis=0), self.rows["dt"][1:]
        turns = np.angle(np.exp(1j * steps[:, 2]))
        true = np.stack([np.hypot(steps[:, 0], steps[:, 1]) / dt, turns / dt], axis=1)
        true = np.vstack([true[:1], true])
        return true + errors * (said - true)

    @cache  # noqa: B019
    def actions(self, errors: float, cells_preset: str) -> list[Action]:
        """What the cells say; no map has a part in it as long as all loops are believed."""
        cells, said = PoseCells(preset=cells_preset), []
        for row, (v, w) in zip(self.rows, self.odometry(errors), strict=True):
            cells.on_view(int(row["vt_id"]), row["vt_rad"])
            cells.on_odometry(v, w, row["dt"])
            said.append(cells.action())
        return said

    def mapped(
        self, preset: str, errors: float, cells_preset: str = "openratslam"
    ) -> tuple[float, float]:
        """RMSE of all steps by odometry alone, and of the map's nodes."""
        graph = ExperienceMap(preset=preset, initial_heading=np.radians(140))
        alone, poses, made = ExperienceMap(preset=preset), [], []
        steps = zip(
            self.actions(errors, cells_preset), self.odometry(errors), self.rows["dt"], strict=True
        )
        for step, (action, (v, w), dt) in enumerate(steps):
            graph.on_odometry(v, w, dt)
            alone.on_odometry(v, w, dt)
            poses.append(alone.pose)
            if action.kind == ActionKind.CREATE_NODE:
                made.append(step)
            assert graph.check(action).accepted
            graph.apply(action)
            if action.kind:
                graph.relax()
        return rmse(poses, self.truth), rmse(graph.nodes, self.truth[made])


@pytest.fixture(scope="module")
def reference(ratslam_reference: Path) -> Reference:
    return Reference(ratslam_reference)


def test_both_presets_are_as_good_as_published_with_the_odometry_of_the_run(
    reference: Reference,
) -> None:
    alone, theirs = reference.mapped("openratslam", 1)
    assert (alone, theirs) == (pytest.approx(0.494, abs=0.0005), pytest.approx(0.175, abs=0.0005))
    assert reference.mapped("robust", 1)[1] <= theirs
    assert reference.mapped("robust", 1, "robust")[1] <= theirs


def test_the_robust_map_is_better_than_the_references_with_twice_the_errors(
    reference: Reference,
) -> None:
    alone, theirs = reference.mapped("openratslam", 2)
    assert alone == pytest.approx(0.99, abs=0.01)
    assert reference.mapped("robust", 2)[1] < theirs
    assert reference.mapped("robust", 2, "robust")[1] < theirs


def test_without_errors_the_odometry_is_the_truth(reference: Reference) -> None:
    alone, mapped = reference.mapped("robust", 0)
    assert alone < 0.02 and mapped < 0.02
