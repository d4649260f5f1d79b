# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The command fleet query: whether any robot has been here."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from fusionslam.cli import options as opt
from fusionslam.cli.console import print_table, progress
from fusionslam.cli.fleet.options import open_folder, where_and_when

if TYPE_CHECKING:
    from fusionslam.errors import FusionSlamError
    from fusionslam.fleet.localization import FleetLocalization
    from fusionslam.fleet.places import Candidate, PlaceFilter
    from fusionslam.fleet.scans import Scan

_HEADS = ("distance", "site", "robot", "recording", "frame", "seen (UTC)")


@opt.options_of(where=where_and_when)
def query(
    scans: Annotated[
        list[Path],
        typer.Argument(
            metavar="SCAN...", help="Clouds (.ply, .pcd, .bin), or recordings, all of their frames."
        ),
    ],
    places: Annotated[
        Path, typer.Option("--places", "-p", metavar="PLACES", help="Folder of fleet describe.")
    ] = Path("out/places"),
    k: Annotated[int, typer.Option("-k", min=1, help="Number of places.")] = 10,
    frame: Annotated[
        list[int] | None,
        typer.Option(
            "--frame",
            metavar="NUMBER",
            help="Of recordings, the frame to look for; may be repeated.",
        ),
    ] = None,
    no_pose: Annotated[
        bool, typer.Option("--no-pose", help="List candidates; prove none by registration.")
    ] = False,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="CSV file for all candidates, with poses."),
    ] = None,
    *,
    where: "Callable[[], PlaceFilter]",
) -> None:
    """Find where scans were seen before, by which robot and when.

    A cloud of a file is a scan like those of the places, and treated as they were. Several scans
    are searched together; a table shows for each the place that proves its pose, or the nearest.
    The exit status is 1 if poses are asked for and none is proven, or if a scan cannot be read.
    """
    if output is not None:
        opt.check_output(output, places, *scans)
    folder, asked = open_folder(places), where()
    from fusionslam.errors import FusionSlamError
    from fusionslam.fleet.scans import list_scans, localize_scans, write_candidates

    seen = list_scans(scans, frame or (), folder.settings.fusion.source)
    with folder.database() as database, progress() as step:
        shown = step if len(seen) > 1 else None
        locator = folder.locator(database)
        found = localize_scans(locator, seen, k, asked, proves=not no_pose, step=shown)
    if output is not None:
        write_candidates(output, seen, found)
    if len(found) == 1 and isinstance(found[0], FusionSlamError):
        raise found[0]
    good = [each for each in found if not isinstance(each, FusionSlamError)]
    if len(found) == 1:
        _print_candidates(good[0].candidates)
        _print_pose(good[0])
    else:
        _print_all(seen, found)
    if output is not None:
        print(output)
    is_any_proven = any(each.place is not None for each in good)
    if len(good) < len(found) or not (is_any_proven or no_pose):
        raise typer.Exit(1)


def _print_candidates(candidates: "Sequence[Candidate]") -> None:
    print_table(_HEADS, [_row(each) for each in candidates])


def _row(each: "Candidate") -> list[str]:
    import datetime

    seen = datetime.datetime.fromtimestamp(each.stamp_ns / 1e9, datetime.UTC)
    return [
        f"{each.distance:.4f}",
        each.site,
        each.robot,
        each.session,
        str(each.frame),
        f"{seen:%Y-%m-%d %H:%M:%S}",
    ]


def _print_all(
    scans: "Sequence[Scan]", found: "Sequence[FleetLocalization | FusionSlamError]"
) -> None:
    """Print a line for each scan, and then why some failed."""
    from fusionslam.errors import FusionSlamError

    failed = [
        f"failed: {scan}: {each}"
        for scan, each in zip(scans, found, strict=True)
        if isinstance(each, FusionSlamError)
    ]
    unknown = [""] * len(_HEADS)
    rows = [
        [
            scan.short_name,
            *([*unknown, each.code] if isinstance(each, FusionSlamError) else _best(each)),
        ]
        for scan, each in zip(scans, found, strict=True)
    ]
    print_table(["scan", *_HEADS, "x, y, z (m), yaw (deg)"], rows)
    for line in failed:
        print(line)


def _best(found: "FleetLocalization") -> list[str]:
    """Return the place that proves a pose, else the nearest, and the pose, or why there is none."""
    best = found.place or next(iter(found.candidates), None)
    place = [""] * len(_HEADS) if best is None else _row(best)
    where, pose = "", found.site_from_robot
    if pose is None:
        where, pose = "from there ", found.place_from_robot
    if pose is None:
        return [*place, "" if found.reason is None else found.reason.code]
    x, y, z, yaw = _numbers(pose)
    return [*place, f"{where}({x:.2f}, {y:.2f}, {z:.2f}) {yaw:.1f}"]


def _print_pose(found: "FleetLocalization") -> None:
    """Print the proven pose, or why there is none; nothing if none was asked for."""
    place = found.place
    if found.reason is not None:
        print(f"not proven: {found.reason}")
    if place is None or found.place_from_robot is None:
        return
    print(
        f"seen by {place.robot or 'a robot'} in {place.session}, frame {place.frame}, "
        f"probability {found.probability:.2f}"
    )
    print(f"from there: {_describe(found.place_from_robot)}")
    if found.site_from_robot is not None:
        print(f"in the frame of {place.session}: {_describe(found.site_from_robot)}")


def _describe(pose: Any) -> str:
    """Say where a pose is."""
    x, y, z, yaw = _numbers(pose)
    return f"x {x:.2f} m, y {y:.2f} m, z {z:.2f} m, yaw {yaw:.1f} deg"


def _numbers(pose: Any) -> tuple[float, float, float, float]:
    """Return x, y, z (metres), and yaw (degrees) of a pose (4, 4)."""
    import numpy as np

    x, y, z = pose[:3, 3].tolist()
    return x, y, z, float(np.degrees(np.arctan2(pose[1, 0], pose[0, 0])))
