# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The command info: what is in a recording."""

from fusionslam.cli import options as opt
from fusionslam.cli.console import print_table


def info(
    data: opt.Data,
    kind: opt.KindOption = None,
    sequence: opt.Sequence = None,
    topic: opt.Topics = None,
    stamps: opt.StampsOption = "header",
    sync: opt.SyncOption = None,
    calib: opt.Calibration = None,
    gt: opt.Truth = None,
    verbose: opt.Verbose = False,
) -> None:
    """Say what is in DATA: frames, sensors, calibration, poses, gaps."""
    from fusionslam.pipelines.overview import look_at

    recording = opt.recording_of(data, kind, sequence, True, gt, topic, stamps, sync, calib)
    print_table(["what", "value"], look_at(recording).rows)
