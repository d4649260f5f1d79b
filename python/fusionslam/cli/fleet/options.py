# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Options that the commands of fleets share."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from fusionslam.fleet.folder import FleetFolder
    from fusionslam.fleet.places import PlaceFilter

Places = Annotated[
    Path, typer.Argument(metavar="PLACES", help="A folder that fleet describe wrote.")
]
Engine = Annotated[
    str,
    typer.Option(
        "--engine",
        metavar="[local|ray|ray://HOST:PORT]",
        help="What runs the workers: processes, Ray on this machine, or a Ray cluster.",
    ),
]
Site = Annotated[str | None, typer.Option("--site", metavar="NAME", help="Of this site alone.")]
Region = Annotated[
    str | None, typer.Option("--region", metavar="NAME", help="Of this region alone.")
]
Robot = Annotated[str | None, typer.Option("--robot", metavar="NAME", help="Of this robot alone.")]
NotSession = Annotated[
    str | None,
    typer.Option("--not-session", metavar="NAME", help="Of any recording but this one."),
]
Session = Annotated[
    str | None, typer.Option("--session", metavar="NAME", help="Of this recording alone.")
]


def where(
    site: Site = None, region: Region = None, robot: Robot = None, session: Session = None
) -> "PlaceFilter":
    """Return which places are meant."""
    from fusionslam.fleet.places import PlaceFilter

    return PlaceFilter(site=site, region=region, robot=robot, session=session)


def open_folder(path: Path) -> "FleetFolder":
    """Open a folder of ``fleet describe``."""
    from fusionslam.fleet.folder import FleetFolder

    return FleetFolder.open(path)
