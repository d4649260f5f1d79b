# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The learned second stage on a robot: inference with ONNX Runtime (Stastny 2022, 4.6).

``fusionslam.learning`` trains it.
"""

from fusionslam.views.second_stage.architecture import ComparisonConfig, HeadConfig, PointNetConfig
from fusionslam.views.second_stage.model import MODELS, SecondStage

__all__ = ["MODELS", "ComparisonConfig", "HeadConfig", "PointNetConfig", "SecondStage"]
