# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Write the page of a map: one file that opens offline."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from fusionslam.errors import DataError
from fusionslam.help_texts import counted
from fusionslam.mapping import Edge, PlaceMap
from fusionslam.report.page.figures import use_style
from fusionslam.report.page.html import about_report, check_extra, write_page
from fusionslam.report.page.images import Picture, draw_picture
from fusionslam.report.place_maps.contents import (
    Drive,
    LoopFit,
    drift_factor,
    fit_loops,
    read_drives,
)
from fusionslam.report.place_maps.figures import (
    LOOP_COLORS,
    TRACK_COLORS,
    draw_cloud,
    draw_drift,
    draw_grid,
    draw_trajectories,
)
from fusionslam.report.place_maps.tables import MOST, refused_table, session_table, state_table
from fusionslam.report.place_maps.view_3d import draw_view_3d
from fusionslam.sensors.frame import Cloud
from fusionslam.storage.arrays import Floats
from fusionslam.storage.files import PathLike

_MOST_PARTS = 3
_VOXELS_ACROSS = 3000
_CELLS_ACROSS = 1500


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
    reasons of those refused, what loops say of the drift model, the cloud and the occupancy grid
    from above, and a view in three dimensions.

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
    fits = fit_loops(site.edges, loops)
    first = site.content.parts[0]
    places = np.concatenate([drive.poses[drive.parts == first, :3, 3] for drive in drives])
    cloud = site.cloud(_voxel_for(places))
    with use_style():
        trajectories = [*_draw_parts(drives, loops)]
        drift = draw_drift(fits)
        above = draw_cloud(cloud, places)
        grid = draw_grid(site.grid(max(0.1, _extent(places) / _CELLS_ACROSS)))
        pictures = {
            "drift": drift and draw_picture("drift", drift, _DRIFT_CAPTION),
            "cloud": above and draw_picture("cloud", above, _caption_of(cloud), photo=True),
            "grid": draw_picture("grid", grid, _GRID_CAPTION),
        }
    size = site.path.stat().st_size
    return write_page(
        path,
        "place_map.html.j2",
        about_report(site.path.name, command, site.config),
        title=f"Map {site.path.stem}",
        notes=notes,
        summary=_summarise(drives, loops),
        size=f"{size / 1e6:.1f} MB, {size / 1e3 / len(site):.0f} kB a keyframe",
        sessions=session_table(drives),
        states=state_table(loops),
        refused=refused_table(loops),
        refused_count=sum(edge.state == "refused" for edge in loops),
        most=MOST,
        drift=_describe_drift(fits),
        trajectories=trajectories,
        pictures=pictures,
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
    believed = sum(edge.state == "believed" for edge in loops)
    figures = {"loops that the map found": f"{believed:,}"}
    drive = drives[0]
    if drive.error is None:
        refused = sum(edge.state == "refused" for edge in loops)
        figures |= {"loops refused": f"{refused:,}", "driven": f"{drive.metres:,.0f} m"}
    else:
        figures["ATE of odometry alone"] = f"{drive.odometry_error:.2f} m"
        figures["ATE of the map"] = f"{drive.error:.2f} m"
    return MapLead(picture, figures)


_DRIFT_CAPTION = (
    "Each dot is a loop: how far its end is from where odometry has it, over the way between. "
    "Grey: the standard deviation of drift and loop by the drift model."
)
_GRID_CAPTION = "White: a robot can drive there. Black: obstacles. Grey: nothing is known."


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


def _summarise(drives: Sequence[Drive], loops: Sequence[Edge]) -> str:
    """Say in one sentence what the map is."""
    keyframes = sum(len(drive.numbers) for drive in drives)
    parts = len(np.unique(np.concatenate([drive.parts for drive in drives])))
    believed, refused = (
        sum(edge.state == state for edge in loops) for state in ("believed", "refused")
    )
    text = (
        f"{counted(keyframes, 'keyframe', ',')} of {counted(len(drives), 'session')} in "
        f"{counted(parts, 'part')}; {counted(len(loops), 'loop', ',')}, {believed:,} of them "
        f"believed and {refused:,} refused."
    )
    judged = [drive for drive in drives if drive.error is not None]
    return text + "".join(
        f" ATE of {drive.name}: {drive.error:.2f} m, of odometry alone "
        f"{drive.odometry_error:.2f} m."
        for drive in judged
    )


def _describe_drift(fits: Sequence[LoopFit]) -> str | None:
    factor = drift_factor(fits)
    if factor is None:
        return None
    return (
        f"Along believed loops the error of odometry is {factor:.2g} times what the drift model "
        "promises, in the median. 1 is as promised; far more means that the stated deviations are "
        "too small. Neighbouring loops share the same drift."
    )


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


def _caption_of(cloud: Cloud) -> str:
    by = "by height" if cloud.colors is None else "as the camera saw it"
    return (
        f"The cloud from above, coloured {by}, without what is more than 2 m above the robot. "
        "Dots: keyframes."
    )


def _extent(places: Floats) -> float:
    return float(np.ptp(places[:, :2], axis=0).max()) + 60.0


def _voxel_for(places: Floats) -> float:
    """Voxels so large that a page of a wide map stays small."""
    return max(0.05, _extent(places) / _VOXELS_ACROSS)
