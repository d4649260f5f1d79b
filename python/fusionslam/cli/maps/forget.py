# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The command map forget: a session leaves a map."""

from typing import Annotated

import typer

from fusionslam.cli import options as opt
from fusionslam.cli.failures import needs_extra


@opt.options_of()
def forget(
    path: opt.MapFile,
    session: Annotated[str, typer.Argument(metavar="SESSION", help="Name of the drive.")],
) -> None:
    """Delete a session of MAP: its keyframes and their loops. That undoes a merge, too."""
    needs_extra("map")
    from fusionslam.mapping import PlaceMap

    with PlaceMap.open(path) as site:
        site.forget(session)
        print(site.describe())
