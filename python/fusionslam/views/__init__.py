# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Recognising places by their objects (Stastny 2022).

scene = build_scene(points, colors)        # a coloured cloud without ground
print(scene.objects["center"])
stored = scene.to_bytes()
print(scene_similarity(scene, Scene.from_bytes(stored)))  # nearly 1

matcher = ViewMatcher()
match = matcher.process(scene)             # or a Cloud, or a Frame
print(match.id, match.is_new, match.reason)
"""

from fusionslam.views.alignment_comparison import (
    Alignment,
    AlignmentConfig,
    AlignmentIndex,
    RangeImage,
    align_scenes,
)
from fusionslam.views.matcher import ViewMatch, ViewMatcher, ViewMatcherConfig
from fusionslam.views.scene_set import SceneSet
from fusionslam.views.scenes import Scene, SceneConfig, build_scene, dbscan
from fusionslam.views.similarity import (
    SceneIndex,
    SimilarityConfig,
    ciede2000,
    color_difference,
    scene_similarity,
)

__all__ = [
    "Alignment",
    "AlignmentConfig",
    "AlignmentIndex",
    "RangeImage",
    "Scene",
    "SceneConfig",
    "SceneIndex",
    "SceneSet",
    "SimilarityConfig",
    "ViewMatch",
    "ViewMatcher",
    "ViewMatcherConfig",
    "align_scenes",
    "build_scene",
    "ciede2000",
    "color_difference",
    "dbscan",
    "scene_similarity",
]
