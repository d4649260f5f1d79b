# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The command fleet status: how far the work on recordings is."""

from fusionslam.cli import options as opt
from fusionslam.cli.console import print_table
from fusionslam.cli.fleet.options import Places
from fusionslam.help_texts import counted


@opt.options_of()
def status(places: Places) -> None:
    """Say how far the work on each recording is, and what failed."""
    from fusionslam.fleet.work import list_status

    found, failures = list_status(places)
    rows = [
        [
            each.recording.session,
            each.recording.site,
            each.recording.robot,
            str(each.frames),
            str(each.done),
            str(each.failed),
        ]
        for each in found
    ]
    print_table(["recording", "site", "robot", "frames", "described", "failed"], rows)
    for failure in failures:
        print(f"failed: {failure.session}: {failure.reason}")
    done, frames = sum(each.done for each in found), sum(each.frames for each in found)
    print(f"{done} of {counted(frames, 'frame')} of {counted(len(found), 'recording')} described")
