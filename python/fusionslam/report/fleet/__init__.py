# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The page of a fleet: its recordings, what failed, and who came by the same places."""

from fusionslam.report.fleet.page import write_fleet_page as write_fleet_page
