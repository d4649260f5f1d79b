# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The command info: what is in a recording."""

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

from fusionslam.cli import options as opt
from fusionslam.cli.console import print_table
from fusionslam.cli.recordings import build_recording

if TYPE_CHECKING:
    from fusionslam.pipelines.recording import Recording


@opt.options_of(build_recording=partial(build_recording, skip_gaps=True))
def info(build_recording: "Callable[[], Recording]") -> None:
    """Summarise DATA: frames, sensors, calibration, poses, gaps."""
    from fusionslam.pipelines.overview import look_at

    print_table(["what", "value"], look_at(build_recording()).rows)
