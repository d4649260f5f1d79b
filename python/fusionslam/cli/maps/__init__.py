# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The commands ``fusionslam map ...``."""

import typer

from fusionslam.cli.maps.build import build
from fusionslam.cli.maps.check import check
from fusionslam.cli.maps.export import export
from fusionslam.cli.maps.forget import forget
from fusionslam.cli.maps.localize import localize
from fusionslam.cli.maps.merge import merge
from fusionslam.cli.maps.show import show

app = typer.Typer(
    help="Build maps that last, and find robots on them.",
    no_args_is_help=True,
    rich_markup_mode=None,
)
for command in (build, show, localize, merge, forget, export, check):
    app.command()(command)
