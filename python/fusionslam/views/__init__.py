# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Recognising places by their objects (Stastny 2022).

scene = build_scene(points, colors)        # a coloured cloud without ground
print(scene.objects["center"])
stored = scene.to_bytes()
"""

from fusionslam.views.scenes import Scene, SceneConfig, build_scene, dbscan

__all__ = ["Scene", "SceneConfig", "build_scene", "dbscan"]
