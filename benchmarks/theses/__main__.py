# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Reproduce two theses: python -m benchmarks.theses [-o FOLDER] [--quick]."""

import shlex
import sys
from pathlib import Path
from typing import Annotated, Any

import typer

from fusionslam.cli import options as opt
from fusionslam.cli.console import print_table, progress
from fusionslam.cli.failures import Guarded, keep, needs_extra

app = typer.Typer(cls=Guarded, add_completion=False, subcommand_metavar="", rich_markup_mode=None)


@app.callback(invoke_without_command=True)
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
    from benchmarks.theses.config import ReproduceConfig, check_config
    from benchmarks.theses.run import reproduce as run

    for extra in ("report", "sim", "bags"):
        needs_extra(extra)
    given: dict[str, Any] = {
        "worlds": _names(worlds),
        "views": _names(views),
        "parts": _names(parts),
        "data": data and str(data),
        "kitti": kitti and str(kitti),
    }
    config = check_config(
        ReproduceConfig(quick=quick, **{k: v for k, v in given.items() if v is not None})
    )
    keep(ctx, output)
    command = shlex.join(["python", "-m", "benchmarks.theses", *sys.argv[1:]])
    with progress() as step:
        page = run(config, output, jobs=opt.cores(jobs), command=command, step=step)
    _print_conclusions(output / "reproduce.json")
    print(page)


def _print_conclusions(path: Path) -> None:
    """Print each conclusion of the theses and whether it was met."""
    import json

    claims = json.loads(path.read_text(encoding="utf-8"))["claims"]
    print_table(["conclusion", "here"], [[each["text"], each["verdict"]] for each in claims])


def _names(text: str | None) -> tuple[str, ...] | None:
    return None if text is None else tuple(dict.fromkeys(n.strip() for n in text.split(",")))


if __name__ == "__main__":
    app(prog_name="python -m benchmarks.theses")
