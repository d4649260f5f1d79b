# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Online loop detection: finds frames that show a place seen before."""

from fusionslam.loop_closure.detector import Loop, LoopConfig, LoopDetector, default_threshold

__all__ = ["Loop", "LoopConfig", "LoopDetector", "default_threshold"]
