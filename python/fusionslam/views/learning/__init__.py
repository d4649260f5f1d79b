# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The learned second stage: a small PointNet and what compares its features (Stastny 2022, 4.6).

Robots need onnxruntime only; training needs torch (``pip install 'fusionslam[learn]'``).
"""

from fusionslam.views.learning.architecture import ComparisonConfig, HeadConfig, PointNetConfig
from fusionslam.views.learning.places import Places, SamePlaceConfig
from fusionslam.views.learning.second_stage import MODELS, SecondStage

__all__ = [
    "MODELS",
    "ComparisonConfig",
    "HeadConfig",
    "Places",
    "PointNetConfig",
    "SamePlaceConfig",
    "SecondStage",
]
