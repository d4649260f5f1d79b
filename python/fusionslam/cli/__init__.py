# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The command line. Importing it loads typer only: commands import what they need themselves."""

import typer

from fusionslam.cli import (
    about,
    bench_views,
    calib_check,
    data,
    ratslam,
    reproduce,
    results,
    ros,
    sim,
)
from fusionslam.cli.failures import Guarded
from fusionslam.cli.views import commands as views
from fusionslam.cli.views.show import show

app = typer.Typer(
    cls=Guarded,
    help="Place recognition and loop closing for robots that carry a LiDAR and a camera.",
    no_args_is_help=True,
    add_completion=False,
    # Errors that nobody foresaw show Python's own traceback.
    pretty_exceptions_enable=False,
    # Boxes around help and errors take room, and errors are one line here.
    rich_markup_mode=None,
)

for command in (
    results.demo,
    sim.sim,
    data.info,
    data.fuse,
    data.describe,
    data.loops,
    calib_check.calib_check,
    results.evaluate,
    results.bench,
    bench_views.bench_views,
    results.report,
    views.tune,
    ratslam.ratslam,
    reproduce.reproduce,
    about.config,
    about.doctor,
):
    names = {"evaluate": "eval", "bench_views": "bench views"}
    app.command(names.get(command.__name__, command.__name__.replace("_", "-")))(command)

views.app.command()(show)
app.add_typer(views.app, name="views")
app.add_typer(ros.app, name="ros")
