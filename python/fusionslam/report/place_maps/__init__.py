# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Pages on maps that are kept."""

from fusionslam.report.place_maps.contents import read_drives
from fusionslam.report.place_maps.page import MapLead, lead_of, write_map_page

__all__ = ["MapLead", "lead_of", "read_drives", "write_map_page"]
