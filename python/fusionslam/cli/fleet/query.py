# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The command fleet query: whether any robot has been here."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from fusionslam.cli import options as opt
from fusionslam.cli.console import print_table
from fusionslam.cli.fleet.options import NotSession, open_folder, where

if TYPE_CHECKING:
    from fusionslam.fleet.folder import FleetFolder
    from fusionslam.fleet.localization import FleetLocalization
    from fusionslam.fleet.places import Candidate, PlaceFilter
    from fusionslam.sensors.frame import Cloud, Frame


@opt.options_of(where=where)
def query(
    scan: Annotated[
        Path,
        typer.Argument(
            metavar="SCAN", help="A cloud (.ply, .pcd, .bin), or a recording with --frame."
        ),
    ],
    places: Annotated[
        Path, typer.Option("--places", "-p", metavar="PLACES", help="Folder of fleet describe.")
    ] = Path("out/places"),
    k: Annotated[int, typer.Option("-k", min=1, help="Number of places.")] = 10,
    frame: Annotated[
        int | None,
        typer.Option("--frame", metavar="NUMBER", help="Of a recording, the frame to look for."),
    ] = None,
    no_pose: Annotated[
        bool, typer.Option("--no-pose", help="List candidates; prove none by registration.")
    ] = False,
    *,
    where: "Callable[[], PlaceFilter]",
    not_session: NotSession = None,
) -> None:
    """Find where a scan was seen before, by which robot and when.

    A cloud of a file is a scan like those of the places, and treated as they were.
    The exit status is 1 if a pose is asked for and none is proven.
    """
    folder = open_folder(places)
    asked = replace(where(), not_session=not_session)
    seen = _read(scan, frame, folder)
    with folder.database() as database:
        locator = folder.locator(database)
        if no_pose:
            _print_candidates(locator.find(seen, k, asked))
            return
        found = locator.localize(seen, k, asked)
    _print_candidates(found.candidates)
    _print_pose(found)


def _read(scan: Path, frame: int | None, folder: "FleetFolder") -> "Frame | Cloud":
    """Return the cloud of a file, or a frame of a recording."""
    from fusionslam.datasets import read_cloud
    from fusionslam.errors import ConfigError
    from fusionslam.pipelines.recording import Recording

    if frame is None:
        return read_cloud(scan)
    dataset = Recording.at(scan).open(folder.settings.fusion.source)
    numbers = dataset.numbers.tolist()
    if frame not in numbers:
        raise ConfigError(
            f"--frame {frame}: {dataset.name} has frames {numbers[0]} to {numbers[-1]}",
            code="choice",
            fields=("--frame", str(frame)),
        )
    seen: Frame = dataset[numbers.index(frame)]
    return seen


def _print_candidates(candidates: "Sequence[Candidate]") -> None:
    rows = [_row(each) for each in candidates]
    print_table(["distance", "site", "robot", "recording", "frame", "seen (UTC)"], rows)


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


def _print_pose(found: "FleetLocalization") -> None:
    """Print the proven pose, or why there is none."""
    if found.place is None or found.place_from_robot is None:
        print(f"not proven: {found.reason}")
        raise typer.Exit(1)
    place = found.place
    print(
        f"seen by {place.robot or 'a robot'} in {place.session}, frame {place.frame}, "
        f"probability {found.probability:.2f}"
    )
    print(f"from there: {_describe(found.place_from_robot)}")
    if found.site_from_robot is not None:
        print(f"in the frame of {place.session}: {_describe(found.site_from_robot)}")


def _describe(pose: Any) -> str:
    """Say where a pose is."""
    import numpy as np

    x, y, z = pose[:3, 3]
    yaw = np.degrees(np.arctan2(pose[1, 0], pose[0, 0]))
    return f"x {x:.2f} m, y {y:.2f} m, z {z:.2f} m, yaw {yaw:.1f} deg"
