# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Where robots go: maps of free space, routes over them, drives along routes, and odometry."""
