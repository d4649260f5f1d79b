# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Online loop detection: finds frames that show a place seen before, and proves it."""

from fusionslam.loop_closure.config import LoopConfig, default_threshold
from fusionslam.loop_closure.detector import LoopDetector
from fusionslam.loop_closure.loop import Loop, Rejected
from fusionslam.loop_closure.observation import Observation, fusion_of_scans

__all__ = [
    "Loop",
    "LoopConfig",
    "LoopDetector",
    "Observation",
    "Rejected",
    "default_threshold",
    "fusion_of_scans",
]
