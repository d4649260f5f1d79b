# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""ROS 2: run nodes by rclpy, play bags, check a robot."""

MESSAGES = "fusionslam_msgs"
"""The package of our messages there."""
