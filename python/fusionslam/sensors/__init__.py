# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Sensor data: messages, clouds, images, cameras and transforms, combined into frames."""

from fusionslam.sensors.frame import Camera, Cloud, Frame

__all__ = ["Camera", "Cloud", "Frame"]
