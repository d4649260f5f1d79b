# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The page of a fleet: its recordings, what failed, and who came by the same places."""

from collections import Counter
from collections.abc import Sequence
from functools import partial
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fusionslam.base.files import PathLike
from fusionslam.fleet.encounters import Encounter
from fusionslam.fleet.folder import FleetFolder
from fusionslam.fleet.place_database import PlaceDatabase, Positions
from fusionslam.fleet.site_maps import site_map_path
from fusionslam.fleet.work import Failure, Status
from fusionslam.mapping import PlaceMap
from fusionslam.report.page.figures import CURVE_COLORS, new_figure, use_style
from fusionslam.report.page.html import about_report, check_extra, picture_name, write_page
from fusionslam.report.page.images import draw_picture
from fusionslam.report.page.tables import Column, Table, build_table, columns_of
from fusionslam.report.place_maps.contents import read_drives
from fusionslam.report.place_maps.figures import draw_trajectories

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MOST = 200
"""Largest number of failures in the table."""
_MOST_SITES = 20
_MOST_NAMED = 12


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
    shown = failures[:MOST]
    rows = [
        {"status": each, "site": each.recording.site or None, "robot": each.recording.robot or None}
        for each in recordings
    ]
    counts = {name: count for name, count in database.count_by("site").items() if name}
    with use_style():
        sites = [
            _draw_site(folder, database, name, count)
            for name, count in islice(counts.items(), _MOST_SITES)
        ]
    return write_page(
        Path(path),
        "fleet.html.j2",
        about_report(folder.path.name, command, folder.settings.dump()),
        title=f"Fleet {folder.path.name}",
        places=len(database),
        frames=sum(each.frames for each in recordings),
        robots=len({each.recording.robot for each in recordings} - {""}),
        sought=len(encounters),
        proven=sum(each.found.place is not None for each in encounters),
        descriptor=folder.settings.names[0],
        recordings=build_table(
            columns_of("fleet.recordings"), rows, [each.recording.session for each in recordings]
        ),
        failures=build_table(columns_of("fleet.failures"), shown, [each.session for each in shown]),
        failure_count=len(failures),
        most=MOST,
        encounters=_encounter_table(encounters),
        index=database.index,
        sites=sites,
    )


def _encounter_table(encounters: Sequence[Encounter]) -> Table | None:
    """Count the places of each drive that were proven in each other one; None without any."""
    asked = Counter(each.session for each in encounters)
    proven = Counter(
        (each.session, each.found.place.session)
        for each in encounters
        if each.found.place is not None
    )
    if not proven:
        return None

    def count(other: str, session: str) -> int | None:
        return None if other == session else proven[session, other]

    hint = "places of the drive that were looked for in all others"
    columns: list[Column[str]] = [Column("asked", hint, lambda session: asked[session])]
    columns += [
        Column(other, "places that were proven in this drive", partial(count, other))
        for other in sorted({other for _, other in proven})
    ]
    return build_table(columns, sorted(asked), sorted(asked))


def _draw_site(
    folder: FleetFolder, database: PlaceDatabase, name: str, places: int
) -> dict[str, Any]:
    """Draw the joint map of a site, or else where its drives say they were."""
    path = site_map_path(folder.path, name)
    if not path.exists():
        figure = _draw_places(database.positions(name))
        picture = draw_picture(picture_name("site", name), figure) if figure else None
        return {"name": name, "places": places, "picture": picture}
    with PlaceMap.open(path, read_only=True) as site:
        drives, loops = read_drives(site), site.loops
        figure = draw_trajectories(drives, loops, int(site.content.parts[0]))
        return {
            "name": name,
            "drives": len(drives),
            "keyframes": len(site),
            "between": sum(edge.kind == "merge" and edge.state == "believed" for edge in loops),
            "picture": draw_picture(picture_name("site", name), figure),
        }


def _draw_places(positions: Positions) -> "Figure | None":
    """Draw the places of a site from above, a colour for each recording; None without poses."""
    known = np.isfinite(positions.poses).all(axis=(1, 2))
    if not known.any():
        return None
    figure = new_figure(6.4, 5.2)
    axis = figure.subplots()
    sessions = np.array(positions.sessions)
    for order, name in enumerate(sorted({*sessions[known].tolist()})):
        x, y = positions.poses[known & (sessions == name), :2, 3].T
        label = name if order < _MOST_NAMED else None
        axis.plot(x, y, ".", color=CURVE_COLORS[order % len(CURVE_COLORS)], ms=4, label=label)
    axis.set_aspect("equal", adjustable="datalim")
    axis.set(xlabel="x (m)", ylabel="y (m)")
    figure.legend(loc="outside lower center", ncols=2)
    return figure
