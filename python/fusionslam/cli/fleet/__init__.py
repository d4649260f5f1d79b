# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The commands ``fusionslam fleet ...``."""

import typer

from fusionslam.cli.fleet.demo import demo
from fusionslam.cli.fleet.describe import describe
from fusionslam.cli.fleet.forget import forget
from fusionslam.cli.fleet.index import index
from fusionslam.cli.fleet.merge import merge
from fusionslam.cli.fleet.query import query
from fusionslam.cli.fleet.report import report
from fusionslam.cli.fleet.status import status

app = typer.Typer(
    help="Describe the recordings of many robots, and find places among all of them.",
    no_args_is_help=True,
    rich_markup_mode=None,
)
for command in (describe, status, index, query, merge, forget, report, demo):
    app.command()(command)
