# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The command line. Importing it loads only typer; each command imports what it needs."""

from typing import Annotated

import typer

from fusionslam.cli import (
    bench,
    demo,
    describe,
    fleet,
    info,
    maps,
    ratslam,
    results,
    ros,
    sensors,
    serve,
    sim,
    views,
    views_train,
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
app.command()(sensors.fuse)
app.command()(describe.describe)
# Version 0.1 spelled this option of loops otherwise.
_FORMER = {"descriptor": "descriptors"}
app.command(context_settings={"token_normalize_func": lambda name: _FORMER.get(name, name)})(
    describe.loops
)
app.command()(sensors.odometry)
app.command()(sensors.calib_check)
app.command()(sensors.calibrate)
app.command("eval")(results.evaluate)
app.command()(bench.bench)
app.command("bench views")(bench.bench_views)
app.command()(results.report)
app.command()(views_train.tune)
app.command()(ratslam.ratslam)
app.command()(serve.serve)
app.command()(info.config)
app.command()(info.doctor)
app.command("help")(show_help)
app.add_typer(maps.app, name="map")
app.add_typer(fleet.app, name="fleet")
app.add_typer(views.app, name="views")
app.add_typer(ros.ros, name="ros")
app.add_typer(ros.ros2, name="ros2")
