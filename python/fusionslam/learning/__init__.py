# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Training of the learned second stage, a small PointNet (Stastny 2022, 4.6).

Training needs torch (``pip install 'fusionslam[learn]'``); robots run what it writes with
``fusionslam.views.second_stage``, which needs onnxruntime only.
"""

from fusionslam.learning.places import Places, SamePlaceConfig

__all__ = ["Places", "SamePlaceConfig"]
