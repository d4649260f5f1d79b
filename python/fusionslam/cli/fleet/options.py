# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Options that the commands of fleets share."""

from dataclasses import replace
from datetime import UTC, datetime, timedelta
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
_TIME = "2026-11-26, 2026-11-26T10:00 or 2026-11-26T10:00+01:00; UTC without an offset"
Since = Annotated[
    str | None,
    typer.Option("--since", metavar="TIME", help=f"Seen at or after this time: {_TIME}."),
]
Until = Annotated[
    str | None, typer.Option("--until", metavar="TIME", help="Seen before this time.")
]
_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
_MOST_NS = 2**63 - 1


def where(
    site: Site = None, region: Region = None, robot: Robot = None, session: Session = None
) -> "PlaceFilter":
    """Return which places are meant."""
    from fusionslam.fleet.places import PlaceFilter

    return PlaceFilter(site=site, region=region, robot=robot, session=session)


def where_and_when(
    site: Site = None,
    region: Region = None,
    robot: Robot = None,
    session: Session = None,
    not_session: NotSession = None,
    since: Since = None,
    until: Until = None,
) -> "PlaceFilter":
    """Return which places are asked.

    Raises:
        ConfigError: a time is none, or no time is between both (code "choice" or "limit").
    """
    from fusionslam.errors import ConfigError

    named = where(site, region, robot, session)
    since_ns, until_ns = _parse_time("--since", since), _parse_time("--until", until)
    if since_ns is not None and until_ns is not None and since_ns >= until_ns:
        raise ConfigError(
            f"--until {until}: expected a time after --since {since}",
            code="limit",
            fields=("--until", str(until)),
        )
    return replace(named, not_session=not_session, since_ns=since_ns, until_ns=until_ns)


def _parse_time(option: str, text: str | None) -> int | None:
    """Return nanoseconds since 1970. Raises ConfigError for what is no time."""
    from fusionslam.errors import ConfigError

    if text is None:
        return None
    try:
        time = datetime.fromisoformat(text)
    except ValueError:
        message = f"{option} {text}: expected a time in ISO 8601, such as {_TIME}"
        raise ConfigError(message, code="choice", fields=(option, text)) from None
    time = time if time.tzinfo else time.replace(tzinfo=UTC)
    stamp_ns = (time - _EPOCH) // timedelta(microseconds=1) * 1000
    if abs(stamp_ns) > _MOST_NS:
        message = f"{option} {text}: expected a time between 1678 and 2261"
        raise ConfigError(message, code="limit", fields=(option, text))
    return stamp_ns


def open_folder(path: Path) -> "FleetFolder":
    """Open a folder of ``fleet describe``."""
    from fusionslam.fleet.folder import FleetFolder

    return FleetFolder.open(path)
