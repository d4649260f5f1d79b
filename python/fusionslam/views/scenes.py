# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""From coloured clouds to scenes; all of it is done by the core."""

from fusionslam._core import Scene, SceneConfig, build_scene, dbscan

__all__ = ["Scene", "SceneConfig", "build_scene", "dbscan"]
