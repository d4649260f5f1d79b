# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The command fleet describe: recordings become places of a database."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer

from fusionslam.cli import options as opt
from fusionslam.cli.console import progress
from fusionslam.cli.failures import keep, needs_extra
from fusionslam.cli.fleet.options import Engine
from fusionslam.help_texts import counted
from fusionslam.storage.progress import Step, label_progress

if TYPE_CHECKING:
    from fusionslam.fleet.folder import FleetFolder
    from fusionslam.fleet.recordings import Labels
    from fusionslam.fleet.work import Failure, Plan


@opt.options_of(read_config=opt.read_config)
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
    read_config: "Callable[[], Any]",
    jobs: Annotated[
        int | None,
        typer.Option("--jobs", "-j", min=1, help="Number of workers; by default one per core."),
    ] = None,
) -> None:
    """Describe all recordings below ROOT, and add their places to a database.

    An interrupted or killed call goes on where it stopped. What cannot be done is in failed.jsonl,
    with the reason; the rest goes on.
    """
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


class Described(NamedTuple):
    """What became of the recordings below a root."""

    folder: "FleetFolder"
    plan: "Plan"
    failures: "list[Failure]"
    places: int


def describe_root(
    root: Path,
    output: Path,
    config: Any,
    *,
    names: list[str],
    labels: "Labels",
    engine: str,
    jobs: int,
    step: Step,
    source: str | None = None,
) -> Described:
    """Describe all recordings below a root; arguments as the command's options."""
    needs_extra("fleet", module="lancedb")
    if engine != "local":
        needs_extra("fleet", module="ray")
    from fusionslam.fleet.engines import check_engine, open_engine
    from fusionslam.fleet.folder import FleetFolder
    from fusionslam.fleet.recordings import find_recordings
    from fusionslam.fleet.settings import settle_settings
    from fusionslam.fleet.work import Plan

    check_engine(engine)
    found = find_recordings(root, labels, excluded=output)
    settings = settle_settings(found, names, config, config.fleet, output, source=source)
    folder = FleetFolder(output, settings)
    plan = Plan.make(root, found, settings, label_progress(step, "opening recordings"))
    workers = open_engine(engine, jobs)
    try:
        show = label_progress(step, "describing frames")
        failures = folder.describe(plan, workers, progress=show)
    finally:
        workers.close()
    with folder.database() as database:
        return Described(folder, Plan.load(output), failures, len(database))


def print_described(described: Described) -> None:
    """Say how much there is, and what failed."""
    plan = described.plan
    recordings, frames = len(plan.recordings), plan.frames
    counts = [(recordings, "recording"), (frames, "frame"), (described.places, "place")]
    print(", ".join(counted(*count) for count in counts))
    _report(described.failures, described.folder.path)


def _report(failures: "list[Failure]", output: Path) -> None:
    """Name what failed, some of it if it is much; the exit status stays 0, as the rest is done."""
    for each in failures[:_SHOWN]:
        part = "" if each.first is None else f", from frame {each.first}"
        print(f"failed: {each.session}{part}: {each.reason}")
    if failures:
        print(f"{counted(len(failures), 'failure')}, all in {output / 'failed.jsonl'}")


_SHOWN = 10
