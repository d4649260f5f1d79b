# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The ROS package builds in a catkin workspace, and its nodes run from there."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from project import PROJECT
from ros_master import RosWorld, needs_ros, wait_until

pytestmark = [
    needs_ros,
    pytest.mark.nightly,
    pytest.mark.skipif(
        shutil.which("catkin_make") is None,
        reason="catkin is not installed: make ros installs it",
    ),
]

MESSAGES = sorted(path.stem for path in (PROJECT / "ros" / "msg").glob("*.msg"))
SUMS = (
    "from fusionslam.ros.ros1.environment import need_ros; need_ros(); "
    "import fusionslam_ros.msg as m; "
    "from fusionslam_ros.srv import Localize as service; "
    f"print(m.__file__, *[getattr(m, name)._md5sum for name in {MESSAGES}], service._md5sum)"
)


@pytest.fixture(scope="module")
def workspace(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("workspace")
    (folder / "src").mkdir()
    (folder / "src" / "fusionslam_ros").symlink_to(PROJECT / "ros")
    command = ["catkin_make", "-C", folder, "-DPYTHON_EXECUTABLE=/usr/bin/python3", "install"]
    built = subprocess.run(command, capture_output=True, text=True, timeout=1800)
    assert built.returncode == 0, built.stdout + built.stderr
    return folder


def source_setup(space: Path, before: dict[str, str]) -> dict[str, str]:
    """The environment of a terminal after the set-up file of a workspace, this Python first."""
    here = Path(sys.executable).parent
    line = f'. "{space}/setup.bash" && export PATH="{here}:$PATH" && env -0'
    result = subprocess.run(["bash", "-c", line], env=before, capture_output=True, check=True)
    return dict(each.split("=", 1) for each in result.stdout.decode().split("\0") if each)


def sums(environment: dict[str, str]) -> tuple[Path, list[str]]:
    """Where the messages come from, and the sum of each."""
    result = subprocess.run(
        [sys.executable, "-c", SUMS], env=environment, capture_output=True, text=True, check=True
    )
    path, *found = result.stdout.split()
    return Path(path), found


@pytest.mark.parametrize(("space", "package"), [("devel", "src"), ("install", "install/share")])
def test_a_workspace_has_our_messages_nodes_that_run_launch_files_and_pictures(
    space: str, package: str, workspace: Path, tmp_path: Path
) -> None:
    environment = source_setup(workspace / space, dict(os.environ))
    (installed, wanted), (built, found) = sums(dict(os.environ)), sums(environment)
    assert built.is_relative_to(workspace / space) and not installed.is_relative_to(workspace)
    assert found == wanted and len(found) == len(set(found)) == len(MESSAGES) + 1 == 9
    with RosWorld(tmp_path) as world:
        world.environment = source_setup(workspace / space, world.environment)
        node = world.run("node", ["rosrun", "fusionslam_ros", "lv_matching"])
        wait_until(lambda: "is ready" in world.log("node") or node.poll() is not None, "a node")
        assert world.end(node) == 0, world.log("node")
        assert "lv_matching is ready" in world.log("node")
    listing = ["roslaunch", "--files", "fusionslam_ros", "ratslam.launch"]
    files = subprocess.run(listing, env=environment, capture_output=True, text=True, check=True)
    folder = workspace / package / "fusionslam_ros"
    included = str((folder / "launch/include/map.launch").resolve())
    assert included in map(os.path.realpath, files.stdout.split())
    assert (folder / "rviz/map.rviz").is_file()
