# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The command info: what is in a recording."""

from typing import TYPE_CHECKING

from fusionslam.cli import options as opt
from fusionslam.cli.console import print_table

if TYPE_CHECKING:
    from fusionslam.pipelines.recording import Recording


@opt.reading_options(skip_gaps=True)
def info(
    *,
    recording: "Recording",
    verbose: opt.Verbose = False,
) -> None:
    """Say what is in DATA: frames, sensors, calibration, poses, gaps."""
    from fusionslam.pipelines.overview import look_at

    print_table(["what", "value"], look_at(recording).rows)
