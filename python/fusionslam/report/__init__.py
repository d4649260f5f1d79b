# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""One HTML file that says how well places were recognised, and the figures behind it."""

from fusionslam.report.assembly import write_report

__all__ = ["write_report"]
