# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The commands around the ROS nodes, with and without ROS."""

from pathlib import Path

import pytest

from cli import fails, run, succeeds
from error_codes import has_code
from fusionslam.errors import FusionSlamError
from fusionslam.ros.ros1 import environment
from fusionslam.ros.ros1 import files as launching
from rows import rows


def test_the_path_is_that_of_a_ros_package() -> None:
    folder = Path(succeeds("ros", "path").stdout.strip())
    assert "<name>fusionslam_ros</name>" in (folder / "package.xml").read_text()


@rows("command", [("run", "lv_builder"), ("launch", "ratslam")])
def test_without_ros_or_its_messages_one_line_says_what_to_install(
    command: tuple[str, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(environment, "find_spec", lambda name: None)
    for has_ros, advice in (
        (False, "apt-get install --no-install-recommends ros-core"),
        (True, "python3-genpy"),
    ):
        monkeypatch.setattr(environment, "has_ros", lambda known=has_ros: known)
        result = run("ros", *command)
        assert result.exit_code in (1, 2) and result.stdout == ""
        (line,) = result.stderr.splitlines()
        assert line.startswith("error: ") and advice in line


def test_unknown_launch_files_are_refused_with_the_known(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(environment, "need_ros", lambda: None)
    line = fails(2, "ros", "launch", "ratslm")
    names = "bag, first_stage, loops, mapper, ratslam, two_stages, visual"
    assert line == (
        f"error: FILE is 'ratslm', expected the path of a launch file or one of {names}"
    )


def test_a_missing_ros_package_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(launching, "_PLACES", (tmp_path,))
    with pytest.raises(FusionSlamError, check=has_code("no-package", "fusionslam_ros")):
        launching.package_folder()
