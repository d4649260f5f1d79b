# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Pictures of scenes: a scan before and after clustering, and two scenes with their matches."""

import os
from collections.abc import Sequence
from itertools import cycle
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from fusionslam._core import Alignment, AlignmentConfig, align_scenes
from fusionslam.geometry.se2 import transform_points
from fusionslam.report.page.figures import new_figure, use_style
from fusionslam.report.page.images import write_png
from fusionslam.views.clusters import ClusteredScan, object_similarities
from fusionslam.views.scenes import SimilarityConfig, scene_similarity

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Flat = NDArray[np.float64]
"""Float64 (N, 2): picture coordinates, right and up, metres."""

_GROUND, _WORDS, _LOOSE = "#15181d", "#e8eaed", "#70757d"
# Okabe and Ito's colours that are visible on a dark background, and white.
_OBJECTS = ("#56B4E9", "#E69F00", "#00B583", "#CC79A7", "#F0E442", "#FF7F3F", "#FFFFFF")
_STORED, _CURRENT = "#56B4E9", "#FF7F3F"
_DOWN = np.radians(30)
"""Downward tilt of the view from behind the robot."""
_LIGHTEST = 0.8
"""End of the colour scale: what lies beyond is too dark for a dark background."""
_EMPTY_M = 5.0
"""Extent of a picture without points, metres."""


def write_scene_picture(path: str | os.PathLike[str], scan: ClusteredScan) -> None:
    """Write a PNG of a scan as measured and as a scene, from behind and from above.

    Raises:
        DataError: the file cannot be written. FusionSlamError: matplotlib is not installed.
    """
    with use_style():
        write_png(path, draw_scene(scan))


def write_pair_picture(
    path: str | os.PathLike[str],
    current: ClusteredScan,
    stored: ClusteredScan,
    similarity: SimilarityConfig,
    alignment: AlignmentConfig | None = None,
) -> None:
    """Write a PNG of two scenes with their most similar objects joined, and optionally aligned.

    Raises:
        DataError, FusionSlamError: as ``write_scene_picture``.
    """
    with use_style():
        write_png(path, draw_pair(current, stored, similarity, alignment))


def draw_scene(scan: ClusteredScan) -> "Figure":
    """Draw a scan before (left) and after clustering into objects, from behind and above."""
    figure = new_figure(7.6, 7.2)
    panels = figure.subplots(2, 2)
    for row, project in zip(panels, (_from_behind, _from_above), strict=True):
        flat = project(scan.points)
        for axis in row:
            _frame(axis, flat, ticks=project is _from_above)
        _points(row[0], flat, scan)
        _objects(row[1], flat, scan)
        _numbers(row[1], project(scan.scene.objects["center"]), scan)
    panels[0, 0].set_title(f"scan {scan.number}: {len(scan.points)} points above the floor")
    size = len(scan.scene.to_bytes(image=False))
    panels[0, 1].set_title(
        f"{len(scan.scene)} objects in {size} bytes; {len(scan.loose)} points in none"
    )
    panels[0, 0].set_ylabel("from behind")
    panels[1, 0].set_ylabel("from above: m ahead")
    for axis in panels[1]:
        axis.set_xlabel("m to the left")
    return figure


def draw_pair(
    current: ClusteredScan,
    stored: ClusteredScan,
    similarity: SimilarityConfig,
    alignment: AlignmentConfig | None = None,
) -> "Figure":
    """Two scenes from above, a line from each object to the one it is most like.

    Args:
        current: scene where the full lines start; dashed lines are the reverse matches, drawn where
            they differ and the similarity counts them.
        stored: scene where the full lines end.
        similarity: how objects are compared.
        alignment: settings of a third panel with one scene laid over the other; None for no panel.
    """
    figure = new_figure(7.6 if alignment is None else 10.8, 4.6)
    panels = figure.subplots(1, 2 if alignment is None else 3)
    both = np.concatenate([_from_above(scan.points) for scan in (current, stored)])
    for axis, scan in zip(panels, (current, stored), strict=False):
        _frame(axis, both, ticks=True)
        _objects(axis, _from_above(scan.points), scan)
        _numbers(axis, _from_above(scan.scene.objects["center"]), scan)
    _draw_matches(figure, panels, (current, stored), similarity)
    whole = scene_similarity(current.scene, stored.scene, config=similarity)
    panels[0].set_title(f"scan {current.number};\nsimilarity of the scenes {whole:.3f}")
    panels[1].set_title(f"scan {stored.number}")
    if alignment is not None:
        found = align_scenes(current.scene, stored.scene, config=alignment)
        _frame(panels[2], both, ticks=True)
        _draw_aligned(panels[2], current, stored, found)
    panels[0].set_ylabel("m ahead")
    for axis in panels:
        axis.set_xlabel("m to the left")
    return figure


def _from_above(points: NDArray[np.floating]) -> Flat:
    """Project from above; the robot looks up from the bottom."""
    return np.stack([-points[:, 1], points[:, 0]], axis=1).astype(np.float64)


def _from_behind(points: NDArray[np.floating]) -> Flat:
    """Project along parallel rays from behind the robot, looking down at it."""
    x, y, z = points.astype(np.float64).T
    return np.stack([-y, x * np.sin(_DOWN) + z * np.cos(_DOWN)], axis=1)


def _frame(axis: "Axes", flat: Flat, *, ticks: bool) -> None:
    """Use the same scale along both axes, with room for all points."""
    from matplotlib.ticker import FuncFormatter, MaxNLocator

    shown = flat if len(flat) else np.array([[-_EMPTY_M / 2, 0], [_EMPTY_M / 2, _EMPTY_M]])
    axis.update_datalim(shown)
    axis.margins(0.06)
    axis.set_facecolor(_GROUND)
    axis.set_aspect("equal", adjustable="datalim")
    if not ticks:
        axis.set(xticks=[], yticks=[])
        return
    axis.xaxis.set_major_locator(MaxNLocator(5, integer=True))
    axis.yaxis.set_major_locator(MaxNLocator(5, integer=True))
    # y of the robot's frame points to the left.
    axis.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{-value + 0:g}"))


def _points(axis: "Axes", flat: Flat, scan: ClusteredScan) -> None:
    """Draw all points in their own colours, the nearest last."""
    order = np.argsort(-scan.points[:, 0], kind="stable")
    _dots(axis, flat[order], scan.colors[order] / 255)


def _objects(axis: "Axes", flat: Flat, scan: ClusteredScan) -> None:
    """Draw each object's points in one colour within its hull; grey points belong to none."""
    _dots(axis, flat[scan.loose], _LOOSE)
    for color, indices in zip(cycle(_OBJECTS), scan.members, strict=False):
        _dots(axis, flat[indices], color)
        axis.fill(*outline(flat[indices]).T, facecolor=(color, 0.18), edgecolor=color, lw=1)


def _numbers(axis: "Axes", centers: Flat, scan: ClusteredScan) -> None:
    """Draw each object's centre in the object's mean colour, with its number."""
    mean = scan.scene.objects["color"] / 255
    x, y = centers.T
    axis.scatter(x, y, c=mean, s=46, edgecolors=_WORDS, linewidths=0.9, zorder=4)
    for number, center in enumerate(centers.tolist()):
        _write_beside(axis, str(number), center, (5, 4), _WORDS, 9)


def _dots(axis: "Axes", flat: Flat, color: Any, label: str = "") -> None:
    axis.scatter(flat[:, 0], flat[:, 1], c=color, s=5, linewidths=0, label=label)


def outline(flat: Flat) -> Flat:
    """Float64 (k, 2): corners of the convex hull; the two ends of points on a line."""
    from scipy.spatial import ConvexHull, QhullError

    try:
        return np.asarray(flat[ConvexHull(flat).vertices])
    except (QhullError, ValueError):  # fewer than three points, or all on a line
        away = flat - flat[0]
        along = away @ away[np.hypot(*away.T).argmax()]
        return flat[[int(along.argmin()), int(along.argmax())]]


def _draw_matches(
    figure: "Figure",
    axes: "Sequence[Axes]",
    scans: tuple[ClusteredScan, ClusteredScan],
    config: SimilarityConfig,
) -> None:
    """Draw lines between most similar objects with their similarity."""
    from matplotlib import colormaps
    from matplotlib.patches import ConnectionPatch

    centers = [_from_above(scan.scene.objects["center"]) for scan in scans]
    table = object_similarities(scans[0].scene, scans[1].scene, config)
    if not table.size:
        return
    there, back = table.argmax(axis=1).tolist(), table.argmax(axis=0).tolist()
    pairs = [(i, j, False) for i, j in enumerate(there)]
    if config.symmetric:
        pairs += [(i, j, True) for j, i in enumerate(back) if there[i] != j]
    for i, j, dashed in pairs:
        ends = centers[0][i], centers[1][j]
        color = colormaps["RdYlGn"](_LIGHTEST * table[i, j])
        line = ConnectionPatch(
            xyA=ends[0],
            xyB=ends[1],
            coordsA=axes[0].transData,
            coordsB=axes[1].transData,
            color=color,
            lw=1.3,
            ls="--" if dashed else "-",
            zorder=3,
        )
        figure.add_artist(line)
        _write_beside(axes[int(dashed)], f"{table[i, j]:.2f}", ends[dashed], (5, -10), color, 8)


def _write_beside(
    axis: "Axes", text: str, place: Any, offset: tuple[int, int], color: Any, size: int
) -> None:
    """Write text at an offset (points) with a rim that keeps it readable on lines and points."""
    from matplotlib.patheffects import withStroke

    axis.annotate(
        text,
        place,
        offset,
        textcoords="offset points",
        color=color,
        fontsize=size,
        path_effects=[withStroke(linewidth=2.2, foreground=_GROUND)],
    )


def _draw_aligned(
    axis: "Axes", current: ClusteredScan, stored: ClusteredScan, found: Alignment
) -> None:
    """Draw the points of both in the stored one's frame."""
    moved = transform_points(current.points, found.x, found.y, found.yaw)
    _dots(axis, _from_above(stored.points), _STORED, f"scan {stored.number}")
    _dots(axis, _from_above(moved), _CURRENT, f"scan {current.number}")
    axis.legend(loc="lower left", labelcolor=_WORDS, markerscale=3)
    axis.set_title(
        f"aligned: x {found.x:.2f} m, y {found.y:.2f} m, yaw {np.degrees(found.yaw):.1f} deg;\n"
        f"probability {found.probability:.3f}"
    )
