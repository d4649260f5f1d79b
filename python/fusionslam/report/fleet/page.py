# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Write the page of a fleet: one file that opens offline."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from fusionslam.fleet.encounters import Encounter
from fusionslam.fleet.folder import FleetFolder
from fusionslam.fleet.place_database import IndexReport, PlaceDatabase
from fusionslam.fleet.site_maps import site_map_path
from fusionslam.fleet.work import Failure, Status
from fusionslam.help_texts import counted
from fusionslam.mapping import PlaceMap
from fusionslam.report.fleet.figures import draw_site
from fusionslam.report.fleet.tables import MOST, encounter_table, failure_table, recording_table
from fusionslam.report.page.figures import use_style
from fusionslam.report.page.html import about_report, check_extra, picture_name, write_page
from fusionslam.report.page.images import Picture, draw_picture
from fusionslam.report.place_maps.contents import read_drives
from fusionslam.report.place_maps.figures import draw_trajectories
from fusionslam.storage.files import PathLike

_MOST_SITES = 20


class _Site(NamedTuple):
    """A site on the page."""

    name: str
    summary: str
    picture: Picture | None


def write_fleet_page(
    path: PathLike,
    folder: FleetFolder,
    database: PlaceDatabase,
    status: tuple[Sequence[Status], Sequence[Failure]],
    encounters: Sequence[Encounter],
    *,
    command: str = "",
) -> Path:
    """Write a page about the places of a fleet; it opens offline.

    It has the recordings and what failed, the index with its measured recall, who came by the same
    places, and the sites: their joint maps, or the places of each drive in its own frame.

    Args:
        path: of the page.
        folder: of the places.
        database: of the folder.
        status: of ``list_status``.
        encounters: of ``find_encounters``.
        command: the command line.

    Raises:
        DataError: the page cannot be written.
        FusionSlamError: matplotlib or jinja2 is not installed.
    """
    check_extra()
    recordings, failures = status
    sites = [name for name in database.count_by("site") if name][:_MOST_SITES]
    with use_style():
        drawn = [*_draw_sites(folder, database, sites)]
    return write_page(
        Path(path),
        "fleet.html.j2",
        about_report(folder.path.name, command, folder.settings.dump()),
        title=f"Fleet {folder.path.name}",
        summary=_summarise(recordings, len(database), encounters),
        descriptor=folder.settings.names[0],
        recordings=recording_table(recordings),
        failures=failure_table(failures),
        failure_count=len(failures),
        most=MOST,
        encounters=encounter_table(encounters),
        index=_describe_index(database.index),
        sites=drawn,
    )


def _summarise(recordings: Sequence[Status], places: int, encounters: Sequence[Encounter]) -> str:
    robots = {each.recording.robot for each in recordings} - {""}
    proven = sum(each.found.place is not None for each in encounters)
    frames = sum(each.frames for each in recordings)
    by = f" by {counted(len(robots), 'robot')}" if robots else ""
    return (
        f"{counted(places, 'place', ',')} of {counted(frames, 'frame', ',')} in "
        f"{counted(len(recordings), 'recording')}{by}. Of {counted(len(encounters), 'place')} that "
        f"were looked for in the drives of others, {proven} were found and proven."
    )


def _describe_index(report: IndexReport | None) -> str:
    if report is None or not report.partitions:
        return "So few places are compared exactly, without an index."
    return (
        f"{report.rows:,} places lie in {report.partitions:,} partitions, of which a query "
        f"searches {report.nprobes}. Of the ten nearest places it finds {report.recall:.2%}, "
        f"measured with {report.queries} of the places themselves."
    )


def _draw_sites(
    folder: FleetFolder, database: PlaceDatabase, sites: Sequence[str]
) -> Iterator[_Site]:
    """Draw the joint map of each site, or else where its drives say they were."""
    counts = database.count_by("site")
    for name in sites:
        path = site_map_path(folder.path, name)
        if path.exists():
            yield _draw_joint(name, path)
            continue
        figure = draw_site(database.positions(name))
        caption = "Places from above, each drive in its own frame: fleet merge joins them."
        picture = figure and draw_picture(picture_name("site", name), figure, caption)
        yield _Site(name, counted(counts[name], "place", ","), picture or None)


def _draw_joint(name: str, path: Path) -> _Site:
    with PlaceMap.open(path, read_only=True) as site:
        drives, loops = read_drives(site, None), site.loops
        figure = draw_trajectories(drives, loops, int(site.content.parts[0]))
        between = sum(edge.kind == "merge" and edge.state == "believed" for edge in loops)
        summary = (
            f"{counted(len(drives), 'drive')} on one map, {counted(len(site), 'keyframe', ',')}, "
            f"{counted(between, 'loop')} between drives"
        )
    caption = "Left: each drive by odometry alone; right: the joint map. Lines join loops."
    return _Site(name, summary, draw_picture(picture_name("site", name), figure, caption))
