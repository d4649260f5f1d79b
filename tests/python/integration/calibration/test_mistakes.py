# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Calibrations that are inverse or for images of another size are told, right ones are not."""

import shutil
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from cli import succeeds
from fusionslam import open_dataset
from fusionslam.calibration.mistakes import warn_of_wrong_calibration
from recordings import town_drive

Matrices = dict[str, NDArray[np.float64]]


def invert(matrices: Matrices) -> None:
    matrices["Tr"] = np.linalg.inv(np.vstack([matrices["Tr"], [0, 0, 0, 1]]))[:3]


def scale(factor: float, matrices: Matrices) -> None:
    """As if the images had another size."""
    for number in range(4):
        matrices[f"P{number}"][:2] *= factor


def miscalibrated(folder: Path, change: Callable[[Matrices], None] | None) -> Path:
    shutil.copytree(town_drive(), folder, symlinks=True)
    path = folder / "sequences/00/calib.txt"
    lines = (line.split(":") for line in path.read_text().splitlines())
    matrices = {name: np.array(values.split(), float).reshape(3, 4) for name, values in lines}
    if change:
        change(matrices)
    path.chmod(0o644)
    path.write_text(
        "".join(f"{name}: {' '.join(map(str, m.ravel()))}\n" for name, m in matrices.items())
    )
    return folder


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "words"),
    [
        (None, ""),
        (invert, "inverse of rectified_from_points"),
        (partial(scale, 0.5), "twice the focal length"),
        (partial(scale, 2), "half the focal length"),
    ],
)
def test_a_mistaken_calibration_is_told(
    change: Callable[[Matrices], None] | None,
    words: str,
    tmp_path: Path,
    caplog: pytest.LogCaptureFixture,
) -> None:
    warn_of_wrong_calibration(open_dataset(miscalibrated(tmp_path / "drive", change)), "lidar")
    said = [each for each in caplog.messages if "calibration" in each]
    assert [words in each for each in said] == [True] * bool(words)


@pytest.mark.slow
def test_commands_tell_it(tmp_path: Path) -> None:
    drive = miscalibrated(tmp_path / "drive", invert)
    for words in (
        ("map", "build", drive, "-o", tmp_path / "town.fsmap", "--odometry", "truth+noise"),
        ("fuse", drive, "-o", tmp_path / "clouds"),
        ("describe", drive, "-d", "cm2dp", "-o", tmp_path / "described"),
        ("loops", drive, "-d", "cm2dp", "-o", tmp_path / "loops"),
    ):
        assert succeeds(*words).stderr.count("its calibration does not fit") == 1, words
    words = ("fuse", drive, "--source", "stereo", "-o", tmp_path / "stereo")
    assert "its calibration does not fit" not in succeeds(*words).stderr


@pytest.mark.parametrize("name", ["kitti/raw_2011_09_26", "bags/small_house_20s.bag"])
def test_calibrations_of_recordings_are_left_alone(
    name: str, test_data: Path, caplog: pytest.LogCaptureFixture
) -> None:
    dataset = open_dataset(test_data / name)
    caplog.clear()
    warn_of_wrong_calibration(dataset, "lidar")
    assert not caplog.messages
