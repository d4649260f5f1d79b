# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Place recognition by local views (Stastny 2022).

scene = build_scene(points, colors)        # a coloured cloud without ground
print(scene.objects["center"])
stored = scene.to_bytes()
print(scene_similarity(scene, Scene.from_bytes(stored)))  # nearly 1

matcher = ViewMatcher()
match = matcher.process(scene)             # or a Cloud, or a Frame
print(match.id, match.is_new, match.reason)
"""

from fusionslam._core import (
    Alignment,
    AlignmentConfig,
    AlignmentIndex,
    RangeImage,
    align_scenes,
)
from fusionslam.views.match import ViewMatch
from fusionslam.views.matcher import ViewMatcher
from fusionslam.views.recognisers import ViewMatcherConfig
from fusionslam.views.scene_set import SceneSet
from fusionslam.views.scenes import (
    Scene,
    SceneConfig,
    SceneIndex,
    SimilarityConfig,
    build_scene,
    ciede2000,
    color_difference,
    dbscan,
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
