# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The command line. Importing it loads only typer; each command imports what it needs."""

from typing import Annotated

import typer

from fusionslam.cli import (
    bench,
    bench_views,
    calib_check,
    config,
    demo,
    describe,
    doctor,
    evaluate,
    fleet,
    fuse,
    info,
    loops,
    maps,
    odometry,
    ratslam,
    report,
    ros,
    ros2,
    serve,
    sim,
    tune,
    views,
)
from fusionslam.cli.failures import Guarded

app = typer.Typer(
    cls=Guarded,
    help="Place recognition and loop closing for robots that carry a LiDAR and a camera.",
    no_args_is_help=True,
    context_settings={"help_option_names": ["-h", "--help"]},
    # Unexpected errors show Python's own traceback.
    pretty_exceptions_enable=False,
    # No boxes around help and errors: they take room, and errors are one line here.
    rich_markup_mode=None,
)


def _print_version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        print(f"fusionslam {version('fusionslam')}")
        raise typer.Exit


@app.callback()
def main(
    version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_print_version, is_eager=True, help="Print the version and exit."
        ),
    ] = False,
) -> None:
    """Declare the options of the program itself."""


def show_help(
    ctx: typer.Context,
    command: Annotated[
        list[str] | None,
        typer.Argument(metavar="[COMMAND]", help="Name of a command, such as views match."),
    ] = None,
) -> None:
    """Print the help of the program or of a command."""
    program = ctx.find_root().command
    words = [*(command or []), "--help"]
    raise typer.Exit(program.main(words, prog_name="fusionslam", standalone_mode=False) or 0)


app.command()(demo.demo)
app.command()(sim.sim)
app.command()(info.info)
app.command()(fuse.fuse)
app.command()(describe.describe)
app.command()(loops.loops)
app.command()(odometry.odometry)
app.command()(calib_check.calib_check)
app.command("eval")(evaluate.evaluate)
app.command()(bench.bench)
app.command("bench views")(bench_views.bench_views)
app.command()(report.report)
app.command()(tune.tune)
app.command()(ratslam.ratslam)
app.command()(serve.serve)
app.command()(config.config)
app.command()(doctor.doctor)
app.command("help")(show_help)
app.add_typer(maps.app, name="map")
app.add_typer(fleet.app, name="fleet")
app.add_typer(views.app, name="views")
app.add_typer(ros.app, name="ros")
app.add_typer(ros2.app, name="ros2")
