# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""A view of a map in three dimensions, which opens offline in a browser."""

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from fusionslam.base.arrays import Floats
from fusionslam.errors import DataError
from fusionslam.report.page.figures import CURVE_COLORS
from fusionslam.report.place_maps.figures import color_heights
from fusionslam.sensors.frame import Cloud

MOST_POINTS = 300_000
"""Points that are shown, so that the view has about 8 MB and turns smoothly."""
_LIFT_M = 0.5


def draw_view_3d(
    cloud: Cloud,
    tracks: Mapping[str, Floats],
    lines: Sequence[tuple[Floats, str]] = (),
    *,
    track_colors: Sequence[str] = CURVE_COLORS,
) -> str:
    """Return a page that shows a coloured cloud and trajectories; the mouse turns it.

    The page holds all it needs, three.js included, which trimesh brings.

    Args:
        cloud: metres, z up, with or without colours. Of more than ``MOST_POINTS`` points, evenly
            spread ones are shown.
        tracks: positions, float64 (n, 3), of each session.
        lines: float64 (2, 3): both ends, and colour (#rrggbb), of further lines, as loops.
        track_colors: of the tracks, one after the other.

    Raises:
        DataError: nothing to show (code "empty").
    """
    from trimesh import Scene
    from trimesh.viewer.notebook import scene_to_html

    scene = Scene()
    _add_cloud(scene, cloud)
    for place, (name, track) in enumerate(tracks.items()):
        _add_lines(scene, name, [track], track_colors[place % len(track_colors)])
    for color in dict.fromkeys(color for _, color in lines):
        _add_lines(scene, f"loops {color}", [ends for ends, own in lines if own == color], color)
    if not scene.geometry:
        raise DataError("the map has neither points nor trajectories to show", code="empty")
    # From the south, 35 degrees from above.
    scene.set_camera(angles=(np.radians(35.0), 0.0, 0.0), resolution=(1200, 800))
    page: str = scene_to_html(scene)
    return page


def _add_cloud(scene: Any, cloud: Cloud) -> None:
    from trimesh import PointCloud

    if not len(cloud):
        return
    chosen = np.linspace(0, len(cloud) - 1, min(len(cloud), MOST_POINTS)).astype(int)
    points = cloud.points[chosen]
    colors = color_heights(points[:, 2]) if cloud.colors is None else cloud.colors[chosen]
    shown = PointCloud(points, colors=colors)  # type: ignore[no-untyped-call]
    scene.add_geometry(shown, geom_name="cloud")


def _add_lines(scene: Any, name: str, paths: Sequence[Floats], color: str) -> None:
    """Add lines of one colour as one object: thousands of objects would be slow."""
    from trimesh.path import Path3D
    from trimesh.path.entities import Line

    paths = [path for path in paths if len(path) > 1]
    if not paths:
        return
    ends = np.cumsum([0, *(len(path) for path in paths)])
    rgba = (*bytes.fromhex(color.removeprefix("#")), 255)
    entities = [
        Line(np.arange(first, last), color=rgba)  # type: ignore[no-untyped-call]
        for first, last in pairwise(ends)
    ]
    lifted = np.concatenate(paths) + np.array([0.0, 0.0, _LIFT_M])  # out of the road
    scene.add_geometry(Path3D(entities, lifted, process=False), geom_name=name)
