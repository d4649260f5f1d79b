# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Pages on maps that are kept."""

from fusionslam.report.place_maps.view_3d import write_map_view, write_view_3d

__all__ = ["write_map_view", "write_view_3d"]
