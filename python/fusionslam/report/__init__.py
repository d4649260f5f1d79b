# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""HTML files that say how well places were recognised and mapped, and the figures behind them."""

from fusionslam.report.assembly import write_report
from fusionslam.report.false_positives import write_false_positive
from fusionslam.report.ratslam import write_ratslam_report
from fusionslam.report.ratslam_maps import map_figure
from fusionslam.report.ratslam_paths import path_figure
from fusionslam.report.views import (
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
