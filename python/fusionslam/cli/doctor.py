# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The command doctor: what works on this machine."""

import typer

from fusionslam.cli.console import print_findings
from fusionslam.cli.failures import DATA, missing_extras


def doctor() -> None:
    """Check what works on this machine, and say what to install."""
    from fusionslam.doctor import examine
    from fusionslam.ros.ros1.environment import check_ros
    from fusionslam.ros.ros2.environment import check_ros2

    findings = [*examine(missing_extras()), check_ros(), check_ros2()]
    print_findings(findings, "missing")
    if not all(finding.fine or finding.optional for finding in findings):
        raise typer.Exit(DATA)
