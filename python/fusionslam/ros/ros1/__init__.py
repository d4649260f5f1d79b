# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""ROS 1: run nodes by rospy, start launch files, play bags."""
