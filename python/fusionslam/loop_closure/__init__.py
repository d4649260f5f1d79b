# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Loops: frames that show a place seen before, found as the robot drives."""

from fusionslam.loop_closure.detector import Loop, LoopConfig, LoopDetector

__all__ = ["Loop", "LoopConfig", "LoopDetector"]
