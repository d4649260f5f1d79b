# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The command map show: what is in a map."""

from pathlib import Path
from typing import Annotated

import typer

from fusionslam.cli import options as opt
from fusionslam.cli.failures import needs_extra


@opt.options_of()
def show(
    path: opt.MapFile,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="Also write a page that shows it (X.html)."),
    ] = None,
) -> None:
    """Print the sessions, loops and size of a map, and write a page that shows it.

    The page has trajectories, loops and reasons, cloud and grid from above, and a view in 3-D.
    """
    needs_extra("map")
    if output is not None:
        needs_extra("report")
        opt.check_output(output, path)
    from fusionslam.mapping import PlaceMap

    with PlaceMap.open(path, read_only=True) as site:
        print(site.describe())
        if output is not None:
            from fusionslam.report.place_maps import write_map_page

            print(write_map_page(output, site, command=opt.command_line()))
