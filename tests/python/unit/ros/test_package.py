# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The catkin package says of itself what the project says."""

import re
from xml.etree import ElementTree

from project import PROJECT


def test_the_version_of_the_package_is_that_of_the_project() -> None:
    project = re.search(r"VERSION (\d+\.\d+\.\d+)", (PROJECT / "CMakeLists.txt").read_text())
    package = ElementTree.parse(PROJECT / "ros" / "package.xml").getroot()
    assert project and package.findtext("version") == project[1]
