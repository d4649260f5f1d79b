# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The Python examples, one of them in a process of its own as their users run them."""

import runpy
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from artefacts import artefact
from bags import drive as bag_events
from bags import write_bag
from kitti import write_sequence
from project import PROJECT
from rows import rows

EXAMPLES = PROJECT / "examples" / "python"


@pytest.fixture(scope="module")
def drive() -> Path:
    """60 places, the first two of them seen again after 58 others."""

    def make(folder: Path) -> None:
        write_sequence(folder, [*range(60), 0, 1], [500] * 62, metres=20, width=128)

    return artefact("examples", make) / "sequences" / "03"


@dataclass
class Run:
    """Runs an example in this process as its users do; returns status and lines of its output."""

    capsys: pytest.CaptureFixture[str]
    monkeypatch: pytest.MonkeyPatch

    def __call__(self, name: str, *arguments: object) -> tuple[object, list[str]]:
        self.monkeypatch.setattr(sys, "argv", [name, *map(str, arguments)])
        status: object = 0
        try:
            runpy.run_path(str(EXAMPLES / name), run_name="__main__")
        except SystemExit as ended:
            status = ended.code
        return status, self.capsys.readouterr().out.splitlines()


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Run:
    return Run(capsys, monkeypatch)


def test_loops_prints_the_places_that_the_drive_comes_back_to(drive: Path) -> None:
    command = [sys.executable, EXAMPLES / "loops.py", drive, "--threshold", "1e-6"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines() == [
        "frame 60 is at the place of frame 0 (0.000)",
        "frame 61 is at the place of frame 1 (0.000)",
        "KITTI odometry 03: 62 frames, 2 loops",
    ]


@pytest.mark.slow
def test_loops_proves_them_and_says_where_they_are(run: Run, drive: Path) -> None:
    status, lines = run("loops.py", drive)
    assert status == 0
    assert lines[0].startswith("frame 60 is at the place of frame 0 (0.00 m from it, probability ")
    assert "KITTI odometry 03: 62 frames, 2 loops" in lines
    assert any("candidates rejected: " in line for line in lines)


def test_overlay_draws_a_picture_of_the_images_size(run: Run, drive: Path, tmp_path: Path) -> None:
    assert run("overlay.py", drive, 3, tmp_path / "overlay.png")[0] == 0
    assert Image.open(tmp_path / "overlay.png").size == (128, 48)


def test_ratslam_maps_its_own_square_and_closes_the_loops(run: Run, tmp_path: Path) -> None:
    assert run("ratslam.py", tmp_path / "nodes.csv") == (0, ["39 nodes, 44 links"])
    x, y, _ = np.loadtxt(tmp_path / "nodes.csv", delimiter=",", skiprows=1).T
    assert np.ptp(x) == pytest.approx(4, abs=0.4) and np.ptp(y) == pytest.approx(4, abs=0.4)


def test_ratslam_maps_what_a_bag_shows(run: Run, tmp_path: Path) -> None:
    pytest.importorskip("rosbags")
    write_bag(tmp_path / "drive.bag", bag_events())
    status, lines = run("ratslam.py", tmp_path / "nodes.csv", tmp_path / "drive.bag")
    assert (status, lines[-1]) == (0, "2 nodes, 1 links")


@rows("name, given, named", [("loops.py", [], "nothing"), ("ratslam.py", ["nodes"], "nothing.bag")])
def test_an_example_names_a_recording_that_is_not_there(
    name: str, given: list[str], named: str, run: Run, tmp_path: Path
) -> None:
    status, _ = run(name, *given, tmp_path / named)
    assert f"{named} does not exist" in str(status)


def test_ratslam_says_in_a_line_that_it_cannot_write(run: Run, tmp_path: Path) -> None:
    for path in (tmp_path, tmp_path / "nowhere" / "nodes.csv"):
        status, _ = run("ratslam.py", path)
        assert str(status).startswith(f"ratslam.py: cannot write {path}: ")
        assert "\n" not in str(status)
