# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The command line. Importing it loads only typer; each command imports what it needs."""

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
    fuse,
    info,
    loops,
    ratslam,
    report,
    ros,
    sim,
    tune,
    views,
)
from fusionslam.cli.failures import Guarded

app = typer.Typer(
    cls=Guarded,
    help="Place recognition and loop closing for robots that carry a LiDAR and a camera.",
    no_args_is_help=True,
    add_completion=False,
    # Unexpected errors show Python's own traceback.
    pretty_exceptions_enable=False,
    # No boxes around help and errors: they take room, and errors are one line here.
    rich_markup_mode=None,
)

app.command()(demo.demo)
app.command()(sim.sim)
app.command()(info.info)
app.command()(fuse.fuse)
app.command()(describe.describe)
app.command()(loops.loops)
app.command()(calib_check.calib_check)
app.command("eval")(evaluate.evaluate)
app.command()(bench.bench)
app.command("bench views")(bench_views.bench_views)
app.command()(report.report)
app.command()(tune.tune)
app.command()(ratslam.ratslam)
app.command()(config.config)
app.command()(doctor.doctor)
app.add_typer(views.app, name="views")
app.add_typer(ros.app, name="ros")
