# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Odometry and view ids in, a map and the robot's place on it out (Stastny 2022, 4.2.5)."""
