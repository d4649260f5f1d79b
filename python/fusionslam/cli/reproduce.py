# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The command that measures again what two theses measured: reproduce."""

from pathlib import Path
from typing import Annotated, Any

import typer

from fusionslam.cli import options as opt
from fusionslam.cli.console import progress
from fusionslam.cli.failures import keep, needs_extra


def reproduce(
    ctx: typer.Context,
    output: Annotated[
        Path, typer.Option("--output", "-o", help="Folder for the page and finished pieces.")
    ] = Path("out/reproduce"),
    quick: Annotated[
        bool, typer.Option("--quick", help="A part of the scans: to see that it works.")
    ] = False,
    data: Annotated[
        Path | None,
        typer.Option(
            "--data",
            metavar="FOLDER",
            envvar="FUSIONSLAM_TEST_DATA",
            help="Folder with recordings/WORLD.npz and what the authors stored; else made worlds.",
        ),
    ] = None,
    kitti: Annotated[
        Path | None,
        typer.Option(
            "--kitti", metavar="FOLDER", help="KITTI odometry for the descriptors, not the town."
        ),
    ] = None,
    worlds: Annotated[
        str | None, typer.Option("--worlds", help="warehouse, house, hospital; with commas.")
    ] = None,
    views: Annotated[
        str | None,
        typer.Option("--views", help="As bench views --methods list says; with commas."),
    ] = None,
    parts: Annotated[
        str | None, typer.Option("--parts", help="views, maps, descriptors; with commas.")
    ] = None,
    jobs: opt.Jobs = None,
    verbose: opt.Verbose = False,
) -> None:
    """Measure again what the two theses measured: one page, their figures beside ours.

    What is finished is kept in the folder: the same command goes on where it was interrupted.
    """
    from fusionslam.reproduce.config import ReproduceConfig, checked
    from fusionslam.reproduce.run import reproduce as run

    for extra in ("report", "sim", "bags"):
        needs_extra(extra)
    given: dict[str, Any] = {
        "worlds": _names(worlds),
        "views": _names(views),
        "parts": _names(parts),
        "data": data and str(data),
        "kitti": kitti and str(kitti),
    }
    config = checked(
        ReproduceConfig(quick=quick, **{k: v for k, v in given.items() if v is not None})
    )
    keep(ctx, output)
    with progress() as step:
        page = run(config, output, jobs=opt.cores(jobs), command=opt.command_line(), step=step)
    print(page)


def _names(text: str | None) -> tuple[str, ...] | None:
    return None if text is None else tuple(dict.fromkeys(n.strip() for n in text.split(",")))
