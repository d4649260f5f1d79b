# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The commands around the ROS nodes, with and without ROS."""

import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from cli import fails, run, succeeds
from error_codes import has_code
from fusionslam.errors import FusionSlamError
from fusionslam.ros.ros1 import environment
from fusionslam.ros.ros1 import files as launching

COMMANDS = [("run", "lv_builder"), ("launch", "ratslam")]


def test_the_path_is_that_of_a_ros_package() -> None:
    folder = Path(succeeds("ros", "path").stdout.strip())
    assert "<name>fusionslam_ros</name>" in (folder / "package.xml").read_text()


@pytest.mark.parametrize("command", COMMANDS)
def test_without_ros_one_line_says_what_to_install(
    command: tuple[str, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(environment, "has_ros", lambda: False)
    result = run("ros", *command)
    assert result.exit_code in (1, 2) and result.stdout == ""
    (line,) = result.stderr.splitlines()
    assert line.startswith("error: ") and "apt-get install --no-install-recommends ros-core" in line


@pytest.mark.parametrize("command", COMMANDS)
def test_without_messages_one_line_says_how_to_get_them(
    command: tuple[str, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(environment, "has_ros", lambda: True)
    monkeypatch.setattr(environment, "find_spec", lambda name: None)
    (line,) = run("ros", *command).stderr.splitlines()
    assert line.startswith("error: ") and "python3-genpy" in line


def test_unknown_launch_files_are_refused_with_those_there_are(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(environment, "need_ros", lambda: None)
    line = fails(2, "ros", "launch", "ratslm")
    names = "bag, first_stage, loops, mapper, ratslam, two_stages, visual"
    assert line == (
        f"error: FILE is 'ratslm', expected the path of a launch file or one of {names}"
    )


def test_what_follows_a_launch_file_goes_to_roslaunch_as_it_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    program = tmp_path / "roslaunch"
    program.write_text('#!/bin/sh\nprintf "%s\\n" "$PWD" "$@"\n')
    program.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path), prepend=":")
    own = tmp_path / "own.launch"
    own.write_text("<launch/>")
    calls: list[Any] = ["own.launch", "scan:=/points", "-p", "11312", "--screen"]
    code = "\n".join(
        [
            "from fusionslam.ros.ros1 import environment",
            "environment.need_ros = lambda: None",
            f"from fusionslam.cli import app; app(['ros', 'launch', *{calls}])",
        ]
    )
    result = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    assert result.stdout.splitlines() == [str(tmp_path), *calls]


def test_an_installation_without_the_package_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(launching, "_PLACES", (tmp_path,))
    with pytest.raises(FusionSlamError, check=has_code("no-package", "fusionslam_ros")):
        launching.package_folder()
