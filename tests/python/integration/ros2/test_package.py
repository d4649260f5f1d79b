# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What the packages for ROS say of themselves, and the commands on a machine without ROS 2."""

import re
from pathlib import Path
from xml.etree import ElementTree

from cli import fails
from project import PROJECT
from rows import rows

PACKAGES = {
    "fusionslam_ros": PROJECT / "ros",
    **{path.parent.name: path.parent for path in PROJECT.glob("ros2/*/package.xml")},
}


@rows("name, folder", PACKAGES.items())
def test_packages_have_a_name_and_the_version_of_the_project(name: str, folder: Path) -> None:
    project = re.search(r"VERSION (\d+\.\d+\.\d+)", (PROJECT / "CMakeLists.txt").read_text())
    package = ElementTree.parse(folder / "package.xml").getroot()
    assert project and package.findtext("version") == project[1]
    assert package.findtext("name") == name
    assert package.get("format") == "3" or name == "fusionslam_ros"


def test_without_ros_2_the_commands_say_how_to_get_it() -> None:
    for words in (("run", "data_fusion"), ("play", "drive.bag"), ("check",)):
        assert "make ros2" in fails(2 if words[0] == "run" else 1, "ros2", *words)


def test_a_bag_is_not_played_at_no_speed() -> None:
    assert "--rate is 0" in fails(2, "ros2", "play", "drive.bag", "--rate", "0")
