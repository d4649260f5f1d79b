# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Checks camera-LiDAR calibration: compares depth edges of scans with edges of images."""
