# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The commands ``fusionslam views ...``."""

import typer

from fusionslam.cli.views import train
from fusionslam.cli.views.curve import curve
from fusionslam.cli.views.match import match
from fusionslam.cli.views.record import record
from fusionslam.cli.views.show import show

app = typer.Typer(
    help="Recognise places by aligning scans, or by objects or descriptors.",
    no_args_is_help=True,
    rich_markup_mode=None,
)
app.add_typer(train.app, name="train")
for command in (record, match, curve, show):
    app.command()(command)
