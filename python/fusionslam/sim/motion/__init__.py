# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Motion planning for simulated robots: occupancy maps, routes over them, drives along routes."""
