# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""A page that shows a map in three dimensions: one file, which opens offline."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from fusionslam.errors import DataError
from fusionslam.mapping import PlaceMap
from fusionslam.sensors.frame import Cloud
from fusionslam.storage.arrays import Floats
from fusionslam.storage.files import PathLike, atomic_path

MOST_POINTS = 300_000
"""Points that are shown, so that the page has about 12 MB and turns smoothly."""
_LIFT_M = 0.5


def write_view_3d(
    path: PathLike,
    cloud: Cloud,
    tracks: Mapping[str, Floats],
    lines: Sequence[tuple[Floats, tuple[int, int, int]]] = (),
) -> Path:
    """Write a page that shows a coloured cloud and trajectories; the mouse turns it.

    The page holds all it needs, three.js included, which trimesh brings.

    Args:
        path: of the page.
        cloud: metres, z up, with or without colours. Of more than ``MOST_POINTS`` points, evenly
            spread ones are shown.
        tracks: positions, float64 (n, 3), of each session.
        lines: float64 (2, 3): both ends, and sRGB colour, of further lines, as loops.

    Raises:
        DataError: nothing to show, or the page cannot be written.
    """
    from trimesh import Scene
    from trimesh.viewer.notebook import scene_to_html

    path = Path(path)
    scene = Scene()
    _add_cloud(scene, cloud)
    for place, (name, track) in enumerate(tracks.items()):
        _add_line(scene, name, track, _TRACK_COLORS[place % len(_TRACK_COLORS)])
    for number, (ends, color) in enumerate(lines):
        _add_line(scene, f"line {number}", ends, color)
    if not scene.geometry:
        raise DataError(
            f"{path}: the map has neither points nor trajectories to show", code="empty"
        )
    # From the south, 35 degrees from above.
    scene.set_camera(angles=(np.radians(35.0), 0.0, 0.0), resolution=(1200, 800))
    page: str = scene_to_html(scene)
    with atomic_path(path) as temporary:
        temporary.write_text(page, encoding="utf-8")
    return path


def write_map_view(path: PathLike, site: PlaceMap, voxel: float = 0.05) -> Path:
    """Write a page that shows a map: its cloud, trajectories, and loops.

    Loops that are believed are green, refused ones orange.

    Args:
        path: of the page.
        site: the map.
        voxel: of the cloud, metres.

    Raises:
        DataError: the map is empty, or the page cannot be written.
    """
    tracks = {each.name: site.trajectory(each.name)[1][:, :3, 3] for each in site.sessions}
    places = site.positions
    lines = [
        (np.array([places[edge.a], places[edge.b]]), _LOOP_COLORS[edge.state])
        for edge in site.loops
    ]
    return write_view_3d(path, site.cloud(voxel), tracks, lines)


_LOOP_COLORS = {"believed": (27, 158, 60), "refused": (230, 120, 0), "pending": (120, 120, 120)}
_TRACK_COLORS = ((33, 102, 172), (178, 24, 43), (118, 42, 131), (27, 120, 55))


def _add_cloud(scene: Any, cloud: Cloud) -> None:
    from trimesh import PointCloud

    if not len(cloud):
        return
    chosen = np.linspace(0, len(cloud) - 1, min(len(cloud), MOST_POINTS)).astype(int)
    colors = _height_colors(cloud.points) if cloud.colors is None else cloud.colors
    shown = PointCloud(cloud.points[chosen], colors=colors[chosen])  # type: ignore[no-untyped-call]
    scene.add_geometry(shown, geom_name="cloud")


def _height_colors(points: Any) -> Any:
    """Greys by height, bright is high."""
    heights = points[:, 2]
    low, high = np.percentile(heights, [2, 98])
    share = np.clip((heights - low) / max(high - low, 1e-6), 0, 1)
    grey = (60 + 140 * share).astype(np.uint8)
    return np.stack([grey] * 3, axis=1)


def _add_line(scene: Any, name: str, points: Floats, color: tuple[int, int, int]) -> None:
    from trimesh.path import Path3D
    from trimesh.path.entities import Line

    if len(points) < 2:
        return
    line = Line(np.arange(len(points)), color=(*color, 255))  # type: ignore[no-untyped-call]
    lifted = points + np.array([0.0, 0.0, _LIFT_M])  # out of the road
    scene.add_geometry(Path3D([line], lifted, process=False), geom_name=name)
