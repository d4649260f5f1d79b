# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Pictures of a frame after each step of fusion (Stastny 2022, figure 4.3)."""

import os
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from fusionslam.base.files import atomic_path
from fusionslam.errors import DataError
from fusionslam.fusion import FusionConfig, color_cloud, remove_ground
from fusionslam.report.page.figures import new_figure, use_style
from fusionslam.sensors.frame import Cloud, Frame

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from fusionslam.datasets import Dataset

# Heights are drawn bright; with colours, both black and white must be visible.
_DARK, _BLUE = "#1d2127", "#2f3d57"
_PLAIN = "#d8dce2"
# Viewpoint behind and above the LiDAR, in units of the extent of the cloud.
_EYE_BEHIND, _EYE_ABOVE = 0.25, 0.25
_LOOKS_DOWN_DEG = 17.0
_HALF_VIEW = 0.62  # tangent of half the horizontal angle of view
_ASPECT = 4 / 3
_MARGIN, _MOST_ZOOM = 1.1, 3.0


def write_stages(
    dataset: "Dataset",
    folder: str | os.PathLike[str],
    config: FusionConfig,
    count: int,
    progress: Callable[[int, int], None] | None = None,
) -> list[Path]:
    """Draw frames spread evenly over a recording: ``folder/NNNNNN.png`` by frame number.

    Args:
        dataset: dataset with the sensors that the configured source needs.
        folder: created if missing.
        config: fusion configuration.
        count: number of pictures, at most the number of frames.
        progress: called with (pictures drawn, total).

    Raises:
        DataError: a frame that cannot be read or fused, or a folder that cannot be written.
        FusionSlamError: matplotlib is missing.
    """
    count = min(count, len(dataset))
    paths = []
    for index in np.linspace(0, len(dataset) - 1, count).round().astype(int).tolist():
        number = int(dataset.numbers[index])
        paths.append(Path(folder) / f"{number:06d}.png")
        try:
            figure = draw_stages(dataset[index], config)
        except DataError as error:
            raise DataError(f"{dataset.name}, frame {number}: {error}") from error
        with atomic_path(paths[-1]) as temporary:
            figure.savefig(temporary, format="png")
        if progress is not None:
            progress(len(paths), count)
    return paths


def draw_stages(frame: Frame, config: FusionConfig) -> "Figure":
    """Camera image, scan, coloured cloud and cloud without ground, side by side.

    The clouds are seen from behind and above the sensor; the scan is coloured by height.

    Raises:
        DataError: as ``fuse``. FusionSlamError: matplotlib is missing.
    """
    cloud = color_cloud(frame, config)
    kept = remove_ground(frame, cloud, config)
    scan = frame.points if frame.points is not None else cloud.points
    scan = scan[np.isfinite(scan).all(axis=1)]
    eye = _Eye(cloud.points, config)
    with use_style():
        figure = new_figure(10.0, 7.9)
        axes = figure.subplots(2, 2).ravel()
        axes[0].set_axis_off()
        axes[0].set_title("no camera image")
        if (image := frame.images.get("left")) is not None:
            axes[0].imshow(image, cmap="gray", vmin=0, vmax=255, interpolation="antialiased")
            axes[0].set_title(f"camera image, {image.shape[1]} x {image.shape[0]}")
        of = "scan" if frame.points is not None else f"cloud ({config.source})"
        _draw_cloud(axes[1], Cloud(scan), eye, f"{of}, {len(scan):,} points, colour is height")
        kind = "coloured cloud" if cloud.colors is not None else "cloud without colours"
        _draw_cloud(axes[2], cloud, eye, f"{kind}, {len(cloud):,} points")
        if config.ground == "none":
            axes[3].set_axis_off()
            axes[3].set_title("ground left in (fusion.ground is none)")
        else:
            title = f"without ground ({config.ground}), {len(kept):,} points"
            _draw_cloud(axes[3], kept, eye, title)
    return figure


class _Eye:
    """A virtual camera behind and above the LiDAR that sees most of a cloud.

    Args:
        points: float32 (N, 3), finite, in the frame of the scan.
        config: gives the up axis and the driving axis.
    """

    def __init__(self, points: NDArray[np.float32], config: FusionConfig) -> None:
        self._axes = _axes(config.up, config.segments.model_dump()["driving"])
        reach = np.linalg.norm(points, axis=1)
        self._reach = float(np.percentile(reach, 90)) if len(reach) else 1.0
        down = np.deg2rad(_LOOKS_DOWN_DEG)
        # Rows: right, down and forward of the viewpoint, from forward, left and up of the robot.
        self._turn = np.array(
            [
                [0, -1, 0],
                [-np.sin(down), 0, -np.cos(down)],
                [np.cos(down), 0, -np.sin(down)],
            ]
        )
        self._middle, self._zoom = 0.0, 1.0
        self._zoom_in(self.look(points)[0])

    def _zoom_in(self, at: NDArray[np.float64]) -> None:
        """Fit the cloud, seen at (M, 2), into the picture; straight ahead stays centred."""
        if len(at) < 2:
            return
        low, high = np.percentile(at[:, 1], [1, 99])
        wide = _MARGIN * float(np.percentile(np.abs(at[:, 0]), 98))
        half = max(wide, _MARGIN * (high - low) / 2 * _ASPECT, 1 / _MOST_ZOOM)
        if half < 1:
            self._middle, self._zoom = float(low + high) / 2, 1 / half

    def heights(self, points: NDArray[np.float32]) -> NDArray[np.float64]:
        """Heights (N,) along the up axis, metres."""
        heights: NDArray[np.float64] = points @ self._axes[2]
        return heights

    def look(self, points: NDArray[np.float32]) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
        """Return image points (M, 2), right and up, 1 at the sides; and indices, farthest first."""
        robot = points @ self._axes.T
        place = self._reach * np.array([-_EYE_BEHIND, 0, _EYE_ABOVE])
        seen = (robot - place) @ self._turn.T
        ahead = np.flatnonzero(seen[:, 2] > 0.02 * self._reach)
        ahead = ahead[np.argsort(-seen[ahead, 2], kind="stable")]
        plane = seen[ahead, :2] / seen[ahead, 2:] / _HALF_VIEW * [1, -1]
        plane = (plane - [0, self._middle]) * self._zoom
        inside = (np.abs(plane[:, 0]) < 1) & (np.abs(plane[:, 1]) < 1 / _ASPECT)
        return plane[inside], ahead[inside]


def _axes(up: str, driving: str) -> NDArray[np.float64]:
    """Return rows: forward, left and up."""
    above = np.eye(3)["xyz".index(up[-1])] * (-1 if up.startswith("-") else 1)
    ahead = np.eye(3)["xyz".index(driving)]
    return np.stack([ahead, np.cross(above, ahead), above])


def _draw_cloud(axis: "Axes", cloud: Cloud, eye: _Eye, title: str) -> None:
    axis.set(xlim=(-1, 1), ylim=(-1 / _ASPECT, 1 / _ASPECT), xticks=[], yticks=[], aspect="equal")
    axis.set_facecolor(_DARK if cloud.colors is None else _BLUE)
    axis.set_title(title)
    at, which = eye.look(cloud.points)
    how: dict[str, Any] = {"color": _PLAIN}
    if cloud.colors is not None:
        how = {"c": cloud.colors[which] / 255}
    elif len(which):
        heights = eye.heights(cloud.points)
        low, high = np.percentile(heights, [2, 95])
        how = {"c": heights[which], "cmap": "viridis", "vmin": low, "vmax": high}
    # Sparse scans get larger dots.
    size = float(np.clip(30_000 / max(len(which), 1), 1, 12))
    axis.scatter(at[:, 0], at[:, 1], s=size, linewidths=0, **how)
