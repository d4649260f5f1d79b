# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The Python examples, run as their users run them."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from bags import drive as bag_events
from bags import write_bag
from kitti import write_sequence
from project import PROJECT

EXAMPLES = PROJECT / "examples" / "python"


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """60 places, the first two of them seen again after 58 others."""
    places = [*range(60), 0, 1]
    base = tmp_path_factory.mktemp("drive")
    return write_sequence(base, places, [500] * 62, metres=20, width=128)


def run(name: str, *arguments: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, str(EXAMPLES / name), *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def test_loops_prints_the_places_that_the_drive_comes_back_to(drive: Path) -> None:
    done = run("loops.py", drive, "--threshold", 1e-6)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines() == [
        "frame 60 is at the place of frame 0 (0.000)",
        "frame 61 is at the place of frame 1 (0.000)",
        "KITTI odometry 03: 62 frames, 2 loops",
    ]


def test_loops_proves_them_and_says_where_they_are(drive: Path) -> None:
    pytest.importorskip("small_gicp")
    done = run("loops.py", drive)
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    assert lines[0].startswith("frame 60 is at the place of frame 0 (0.00 m from it, probability ")
    assert "KITTI odometry 03: 62 frames, 2 loops" in lines
    assert any("candidates rejected: " in line for line in lines)


def test_loops_names_a_folder_that_is_not_there(tmp_path: Path) -> None:
    done = run("loops.py", tmp_path / "nothing")
    assert done.returncode == 1 and "nothing does not exist" in done.stderr
    assert "Traceback" not in done.stderr


def test_overlay_draws_a_picture_of_the_images_size(drive: Path, tmp_path: Path) -> None:
    done = run("overlay.py", drive, 3, tmp_path / "overlay.png")
    assert done.returncode == 0, done.stderr
    assert Image.open(tmp_path / "overlay.png").size == (128, 48)


def test_ratslam_maps_its_own_square_and_closes_the_loops(tmp_path: Path) -> None:
    done = run("ratslam.py", tmp_path / "nodes.csv")
    assert done.returncode == 0, done.stderr
    assert done.stdout == "39 nodes, 44 links\n"
    x, y, _ = np.loadtxt(tmp_path / "nodes.csv", delimiter=",", skiprows=1).T
    assert np.ptp(x) == pytest.approx(4, abs=0.4) and np.ptp(y) == pytest.approx(4, abs=0.4)


def test_ratslam_maps_what_a_bag_shows(tmp_path: Path) -> None:
    pytest.importorskip("rosbags")
    write_bag(tmp_path / "drive.bag", bag_events())
    done = run("ratslam.py", tmp_path / "nodes.csv", tmp_path / "drive.bag")
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-1] == "2 nodes, 1 links"


def test_ratslam_says_in_a_line_that_it_cannot_write(tmp_path: Path) -> None:
    for path in (tmp_path, tmp_path / "nowhere" / "nodes.csv"):
        done = run("ratslam.py", path)
        assert done.returncode == 1
        assert done.stderr.startswith(f"ratslam.py: cannot write {path}: ")
        assert done.stderr.count("\n") == 1


def test_ratslam_names_a_bag_that_is_not_there(tmp_path: Path) -> None:
    done = run("ratslam.py", tmp_path / "nodes.csv", tmp_path / "nothing.bag")
    assert done.returncode == 1 and "nothing.bag" in done.stderr
    assert "Traceback" not in done.stderr
