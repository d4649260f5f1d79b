# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""How alike scenes are, one with another or one with many; all of it is done by the core."""

from fusionslam._core import (
    SceneIndex,
    SimilarityConfig,
    ciede2000,
    color_difference,
    scene_similarity,
)

__all__ = ["SceneIndex", "SimilarityConfig", "ciede2000", "color_difference", "scene_similarity"]
