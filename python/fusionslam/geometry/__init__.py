# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Rigid motions in the plane and in space, trajectories, and the noise of odometry."""
