# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""HTML reports on place recognition and mapping, with their figures as files."""

from fusionslam.report.loops.page import write_report
from fusionslam.report.maps.map_figures import map_figure, path_figure
from fusionslam.report.maps.page import write_ratslam_report
from fusionslam.report.views.false_positives import write_false_positive
from fusionslam.report.views.page import (
    has_view_runs,
    load_view_runs,
    write_stored_view_report,
    write_view_report,
)

__all__ = [
    "has_view_runs",
    "load_view_runs",
    "map_figure",
    "path_figure",
    "write_false_positive",
    "write_ratslam_report",
    "write_report",
    "write_stored_view_report",
    "write_view_report",
]
