# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Write the page of a map: one file that opens offline."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from fusionslam.base.arrays import Floats
from fusionslam.base.files import PathLike
from fusionslam.errors import DataError
from fusionslam.mapping import Edge, MapQuality, PlaceMap, judge_map
from fusionslam.report.page.figures import LOOP_COLORS, TRACK_COLORS, use_style
from fusionslam.report.page.html import about_report, check_extra, group_by, write_page
from fusionslam.report.page.images import Picture, draw_picture
from fusionslam.report.page.tables import Table, build_table, columns_of
from fusionslam.report.place_maps.contents import Drive, drift_factor, fit_loops, read_drives
from fusionslam.report.place_maps.figures import (
    draw_cloud,
    draw_drift,
    draw_grid,
    draw_quality,
    draw_trajectories,
)
from fusionslam.report.place_maps.view_3d import draw_view_3d
from fusionslam.sensors.frame import Cloud

MOST = 200
"""Largest number of refused loops in the table."""
_MOST_PARTS = 3
_VOXELS_ACROSS = 3000
_CELLS_ACROSS = 1500


def session_table(drives: Sequence[Drive]) -> Table:
    """Build the table of sessions, with errors where the truth is known."""
    judged = any(drive.error is not None for drive in drives)
    columns = columns_of("place_map.sessions")
    columns += columns_of("place_map.errors") if judged else []
    return build_table(columns, drives, [drive.name for drive in drives])


def state_table(loops: Sequence[Edge]) -> Table | None:
    """Count loops by state and reason; None without loops."""
    kinds = group_by(loops, lambda edge: (edge.state, edge.reason.code if edge.reason else ""))
    found = sorted(kinds.items(), key=lambda item: -len(item[1]))
    rows = []
    for (_, code), edges in found:
        numbers = [edge.reason.number for edge in edges if edge.reason is not None]
        median = f"{np.median(numbers):.3g}" if numbers else ""
        merges = sum(edge.kind == "merge" for edge in edges)
        rows.append({"reason": code, "loops": len(edges), "merges": merges, "median": median})
    labels = [state for (state, _), _ in found]
    return build_table(columns_of("place_map.states"), rows, labels) if rows else None


def refused_table(loops: Sequence[Edge]) -> Table | None:
    """List refused loops with their reasons, at most ``MOST``; None without one."""
    refused = [edge for edge in loops if edge.state == "refused"][:MOST]
    labels = [f"{edge.a} and {edge.b}" for edge in refused]
    return build_table(columns_of("place_map.refused"), refused, labels) if refused else None


def weak_table(quality: MapQuality) -> Table | None:
    """List weak places with their reasons, at most ``MOST``; None without one."""
    weak = quality.weak_places[:MOST]
    labels = [f"{each.first} to {each.last}" for each in weak]
    return build_table(columns_of("place_map.weak"), weak, labels) if weak else None


def influence_table(quality: MapQuality) -> Table | None:
    """List the loops that change most; None without loops."""
    labels = [f"{each.edge.a} and {each.edge.b}" for each in quality.influences]
    columns = columns_of("place_map.influences")
    return build_table(columns, quality.influences, labels) if labels else None


def write_map_page(
    path: PathLike,
    site: PlaceMap,
    truth: Mapping[str, Floats] | None = None,
    *,
    command: str = "",
    notes: Sequence[str] = (),
) -> Path:
    """Write a page that shows a map; it opens offline.

    It has the trajectories by odometry alone and as corrected, loops by their state with the
    reasons of those refused, how good the map is and where it is weak, what loops say of the drift
    model, the cloud and the occupancy grid from above, and a view in three dimensions.

    Args:
        path: of the page.
        site: the map.
        truth: float64 (n, 4, 4), true poses of the keyframes of sessions, of the robot; rows with
            NaN are unknown.
        command: the command line that built the map.
        notes: sentences at the top of the page.

    Raises:
        DataError: the map has no keyframes (code "empty"), the page is the map
            ("output-is-input"), or it cannot be written.
        FusionSlamError: matplotlib or jinja2 is not installed.
    """
    check_extra()
    path = Path(path)
    if path.exists() and path.samefile(site.path):
        raise DataError(
            f"{path} is the map that is shown: write the page to another place",
            code="output-is-input",
            fields=(str(path),),
        )
    if not len(site):
        raise DataError(f"{site.path}: the map has no keyframes to show", code="empty")
    drives, loops = read_drives(site, truth), site.loops
    fits, quality = fit_loops(site.edges, loops), judge_map(site)
    first = site.content.parts[0]
    places = np.concatenate([drive.poses[drive.parts == first, :3, 3] for drive in drives])
    extent = float(np.ptp(places[:, :2], axis=0).max()) + 60.0
    # Voxels so large that a page of a wide map stays small.
    cloud = site.cloud(max(0.05, extent / _VOXELS_ACROSS))
    with use_style():
        trajectories = [*_draw_parts(drives, loops)]
        drift = draw_drift(fits)
        above = draw_cloud(cloud, places)
        pictures = {
            "quality": draw_picture("quality", draw_quality(drives, quality, first)),
            "drift": drift and draw_picture("drift", drift),
            "cloud": above and draw_picture("cloud", above, photo=True),
            "grid": draw_picture("grid", draw_grid(site.grid(max(0.1, extent / _CELLS_ACROSS)))),
        }
    return write_page(
        path,
        "place_map.html.j2",
        about_report(site.path.name, command, site.config),
        title=f"Map {site.path.stem}",
        notes=notes,
        size=site.path.stat().st_size,
        keyframes=len(site),
        drives=drives,
        parts=len(np.unique(np.concatenate([drive.parts for drive in drives]))),
        counts=Counter(edge.state for edge in loops),
        sessions=session_table(drives),
        states=state_table(loops),
        refused=refused_table(loops),
        quality=quality,
        weak=weak_table(quality),
        influences=influence_table(quality),
        most=MOST,
        drift=drift_factor(fits),
        trajectories=trajectories,
        pictures=pictures,
        is_coloured=cloud.colors is not None,
        view=_draw_view(cloud, drives, loops, first),
    )


class MapLead(NamedTuple):
    """What a report says of a map at its top: a picture, and figures with what they are."""

    picture: Picture
    figures: dict[str, str]


def lead_of(site: PlaceMap, truth: Mapping[str, Floats] | None = None) -> MapLead:
    """Draw the trajectories of a map, for the top of a report on the drive of its first session.

    Args:
        site: the map, which is not empty.
        truth: as of ``write_map_page``.
    """
    drives, loops = read_drives(site, truth), site.loops
    with use_style():
        picture = next(_draw_parts(drives, loops))
    counts = Counter(edge.state for edge in loops)
    figures = {"loops that the map found": f"{counts['believed']:,}"}
    drive = drives[0]
    if drive.error is None:
        figures |= {"loops refused": f"{counts['refused']:,}", "driven": f"{drive.metres:,.0f} m"}
    else:
        figures["ATE of odometry alone"] = f"{drive.odometry_error:.2f} m"
        figures["ATE of the map"] = f"{drive.error:.2f} m"
    return MapLead(picture, figures)


def _draw_parts(drives: Sequence[Drive], loops: Sequence[Edge]) -> Iterator[Picture]:
    """Draw the trajectories of the largest parts."""
    parts, counts = np.unique(np.concatenate([drive.parts for drive in drives]), return_counts=True)
    for part in parts[np.argsort(-counts, kind="stable")][:_MOST_PARTS]:
        which = f"The part of keyframe {part}. " if len(parts) > 1 else ""
        caption = (
            f"{which}Left: where odometry alone has the robot; right: the map. Lines join the "
            "keyframes of loops: green believed, orange refused, grey not solved yet."
        )
        figure = draw_trajectories(drives, loops, int(part))
        yield draw_picture(f"trajectories-{part}", figure, caption)


def _draw_view(cloud: Cloud, drives: Sequence[Drive], loops: Sequence[Edge], part: int) -> str:
    """The page in three dimensions of a part of the map."""
    tracks = {
        drive.name: drive.poses[drive.parts == part, :3, 3]
        for drive in drives
        if (drive.parts == part).sum() > 1
    }
    places = {
        number: pose[:3, 3]
        for drive in drives
        for number, pose, own in zip(drive.numbers.tolist(), drive.poses, drive.parts, strict=True)
        if own == part
    }
    lines = [
        (np.array([places[edge.a], places[edge.b]]), LOOP_COLORS[edge.state])
        for edge in loops
        if edge.a in places and edge.b in places
    ]
    return draw_view_3d(cloud, tracks, lines, track_colors=TRACK_COLORS)
