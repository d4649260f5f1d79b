# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The commands ``fusionslam fleet ...``."""

from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, cast

import typer

from fusionslam.base.texts import counted
from fusionslam.cli import options as opt
from fusionslam.cli.console import print_table, progress
from fusionslam.cli.failures import keep, needs_extra
from fusionslam.cli.maps import ODOMETRY, Odometry
from fusionslam.errors import ConfigError

if TYPE_CHECKING:
    from fusionslam.fleet.places import PlaceFilter
    from fusionslam.pipelines.place_maps import MapOdometry

app = typer.Typer(
    help="Describe the recordings of many robots, and find places among all of them.",
    no_args_is_help=True,
    rich_markup_mode=None,
)

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
_TIME = "2026-11-26, 2026-11-26T10:00 or 2026-11-26T10:00+01:00; UTC without an offset"
_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
_MOST_NS = 2**63 - 1


def where_and_when(
    site: Annotated[
        str | None, typer.Option("--site", metavar="NAME", help="Of this site alone.")
    ] = None,
    region: Annotated[
        str | None, typer.Option("--region", metavar="NAME", help="Of this region alone.")
    ] = None,
    robot: Annotated[
        str | None, typer.Option("--robot", metavar="NAME", help="Of this robot alone.")
    ] = None,
    session: Annotated[
        str | None, typer.Option("--session", metavar="NAME", help="Of this recording alone.")
    ] = None,
    not_session: Annotated[
        str | None,
        typer.Option("--not-session", metavar="NAME", help="Of any recording but this one."),
    ] = None,
    since: Annotated[
        str | None,
        typer.Option("--since", metavar="TIME", help=f"Seen at or after this time: {_TIME}."),
    ] = None,
    until: Annotated[
        str | None, typer.Option("--until", metavar="TIME", help="Seen before this time.")
    ] = None,
) -> "PlaceFilter":
    """Return which places are asked.

    Raises:
        ConfigError: a time is none, or no time is between both (code "choice" or "limit").
    """
    from fusionslam.fleet.places import PlaceFilter

    since_ns, until_ns = _parse_time("--since", since), _parse_time("--until", until)
    if since_ns is not None and until_ns is not None and since_ns >= until_ns:
        raise ConfigError(
            f"--until {until}: expected a time after --since {since}",
            code="limit",
            fields=("--until", str(until)),
        )
    return PlaceFilter(site, region, robot, session, not_session, since_ns, until_ns)


def _parse_time(option: str, text: str | None) -> int | None:
    """Return nanoseconds since 1970. Raises ConfigError for what is no time."""
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


@app.command()
@opt.command
def describe(
    ctx: typer.Context,
    root: Annotated[
        Path, typer.Argument(metavar="ROOT", help="Folder with recordings, at any depth.")
    ],
    output: Annotated[
        Path, typer.Option("--output", "-o", help="Folder of places, made or gone on with.")
    ] = Path("out/places"),
    engine: Engine = "local",
    descriptors: Annotated[
        str,
        typer.Option(
            "--descriptors", "-d", metavar="NAME,...", help="The first one is searched by."
        ),
    ] = "cm2dp",
    source: opt.Source = None,
    folders: Annotated[
        str,
        typer.Option(
            "--folders",
            metavar="NAME/...",
            help="What folders below ROOT are names of: some of region, site and robot, with /.",
        ),
    ] = "",
    robot: Annotated[
        str, typer.Option("--robot", metavar="NAME", help="Where no folder names one.")
    ] = "",
    site: Annotated[
        str, typer.Option("--site", metavar="NAME", help="Where no folder names one.")
    ] = "",
    region: Annotated[
        str, typer.Option("--region", metavar="NAME", help="Where no folder names one.")
    ] = "",
    *,
    read_config: opt.ReadConfig,
    jobs: Annotated[
        int | None,
        typer.Option("--jobs", "-j", min=1, help="Number of workers; by default one per core."),
    ] = None,
) -> None:
    """Describe all recordings below ROOT, and add their places to a database.

    An interrupted or killed call goes on where it stopped. What cannot be done is in failed.jsonl,
    with the reason; the rest goes on.
    """
    from fusionslam.cli.fleet_work import describe_root, print_described
    from fusionslam.fleet.recordings import Labels

    whole = read_config()
    names = opt.parse_names(descriptors, whole.descriptors.preset)
    labels = Labels(tuple(filter(None, folders.split("/"))), robot, site, region)
    keep(ctx, output)
    with progress() as step:
        described = describe_root(
            root,
            output,
            whole,
            names=names,
            labels=labels,
            engine=engine,
            jobs=opt.cores(jobs),
            step=step,
            source=source,
        )
    print_described(described)
    print(output)


@app.command()
@opt.command
def status(places: Places) -> None:
    """Say how far the work on each recording is, and what failed."""
    from fusionslam.fleet.work import list_status

    found, failures = list_status(places)
    rows = [
        [
            each.recording.session,
            each.recording.site,
            each.recording.robot,
            str(each.frames),
            str(each.done),
            str(each.failed),
        ]
        for each in found
    ]
    print_table(["recording", "site", "robot", "frames", "described", "failed"], rows)
    for failure in failures:
        print(f"failed: {failure.session}: {failure.reason}")
    done, frames = sum(each.done for each in found), sum(each.frames for each in found)
    print(f"{done} of {counted(frames, 'frame')} of {counted(len(found), 'recording')} described")


@app.command()
@opt.command
def index(
    places: Places,
    recall: Annotated[
        float,
        typer.Option(
            "--recall", help="Share of the ten nearest places that queries must find, measured."
        ),
    ] = 0.99,
    compact: Annotated[
        bool,
        typer.Option("--compact", help="Only take in what was added, and free the disk's space."),
    ] = False,
) -> None:
    """Build the index of a database, and measure its recall on the places themselves."""
    from fusionslam.fleet.folder import FleetFolder

    folder = FleetFolder.open(places)
    with folder.database(read_only=False) as database, progress() as step:

        def show(text: str) -> None:
            step(text, 0, 1)

        database.compact(renews=compact, progress=show)  # many small files are slow
        report = database.index if compact else database.build_index(recall=recall, progress=show)
        count = len(database)
    if report is None or not report.partitions:
        print(f"{count} places: so few are compared exactly, without an index")
        return
    if report.recall < recall:
        print(f"the recall asked for, {recall:g}, is not reached")
    print(
        f"{report.rows} places in {report.partitions} partitions, of which {report.nprobes} are "
        f"searched: recall {report.recall:.4f} of {report.queries} queries, {report.seconds:.0f} s"
    )


@app.command()
@opt.command
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
    where: Annotated[Callable[[], "PlaceFilter"], where_and_when],
) -> None:
    """Find where scans were seen before, by which robot and when.

    A cloud of a file is a scan like those of the places, and treated as they were. Several scans
    are searched together; a table shows for each the place that proves its pose, or the nearest.
    The exit status is 1 if poses are asked for and none is proven, or if a scan cannot be read.
    """
    if output is not None:
        opt.check_output(output, places, *scans)
    from fusionslam.cli.fleet_work import print_all, print_candidates, print_pose
    from fusionslam.errors import FusionSlamError
    from fusionslam.fleet.folder import FleetFolder
    from fusionslam.fleet.scans import list_scans, localize_scans, write_candidates

    folder, asked = FleetFolder.open(places), where()
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
        print_candidates(good[0].candidates)
        print_pose(good[0])
    else:
        print_all(seen, found)
    if output is not None:
        print(output)
    is_any_proven = any(each.place is not None for each in good)
    if len(good) < len(found) or not (is_any_proven or no_pose):
        raise typer.Exit(1)


@app.command()
@opt.command
def merge(
    ctx: typer.Context,
    places: Places,
    site: Annotated[str, typer.Argument(metavar="SITE", help="Name of the site.")],
    odometry: Odometry = "recorded",
    *,
    read_config: opt.ReadConfig,
    jobs: opt.Jobs = None,
) -> None:
    """Join all drives at SITE in one map; drives that came since the last call are added.

    A drive that no three loops join with the others is left out until others join it. One whose
    recording has changed is mapped and joined anew. The exit status is 1 if one is left out.
    """
    needs_extra("map")
    from fusionslam.fleet.config import FleetSettings
    from fusionslam.fleet.site_maps import merge_site
    from fusionslam.fleet.work import Plan
    from fusionslam.mapping import PlaceMap

    whole = read_config()
    settings, plan = FleetSettings.load(places), Plan.load(places)
    keep(ctx, places)
    with progress() as step:
        done = merge_site(
            places,
            site,
            plan.recordings,
            settings,
            odometry=cast("MapOdometry", opt.check_choice("odometry", odometry, ODOMETRY)),
            mapping=whole.mapping,
            jobs=opt.cores(jobs),
            step=step,
        )
    for session, reason in done.left_out.items():
        print(f"left out: {session}: {reason}")
    print(f"{counted(len(done.added), 'drive')} added, {len(done.known)} known")
    if done.path.exists():
        with PlaceMap.open(done.path, read_only=True) as joint:
            print(joint.describe())
        print(done.path)
    if done.left_out:
        raise typer.Exit(1)


@app.command()
@opt.command
def forget(
    places: Places,
    *,
    where: Annotated[
        Callable[[], "PlaceFilter"],
        partial(where_and_when, not_session=None, since=None, until=None),
    ],
) -> None:
    """Delete all places of a robot, recording, site or region, with their clouds and maps.

    No query finds them any more, and fleet describe leaves their recordings out from now on
    (forgotten.json).
    """
    from fusionslam.fleet.folder import FleetFolder

    count = FleetFolder.open(places).forget(where())
    print(f"{counted(count, 'place')} forgotten; such recordings are left out from now on")


@app.command()
@opt.command
def report(
    places: Places,
    most: Annotated[
        int,
        typer.Option(
            "--asked", min=0, help="Places of each drive that are looked for in all others."
        ),
    ] = 10,
) -> None:
    """Write a page: recordings, failures, sites, and which drives came by the same places."""
    from fusionslam.cli.fleet_work import write_page

    with progress() as step:
        page = write_page(places, most, step)
    print(page)


@app.command()
@opt.command
def demo(
    ctx: typer.Context,
    output: opt.Folder = Path("out/fleet"),
    engine: Engine = "local",
    *,
    jobs: opt.Jobs = None,
) -> None:
    """Two robots drive in each of two made towns: describe, index, join and show their drives."""
    for extra in ("sim", "map", "report", "fleet"):
        needs_extra(extra)
    from fusionslam.cli.fleet_work import print_described, run_demo

    keep(ctx, output)
    with progress() as step:
        described, merges, page = run_demo(output, engine, opt.cores(jobs), step)
    print_described(described)
    for site, merge in merges.items():
        joined = len(merge.known) + len(merge.added)
        print(f"{site}: {counted(joined, 'drive')} on one map, {len(merge.left_out)} left out")
    print(page)
