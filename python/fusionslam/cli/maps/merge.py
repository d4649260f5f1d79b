# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The command map merge: two maps become one."""

from pathlib import Path
from typing import Annotated

import typer

from fusionslam.cli import options as opt
from fusionslam.cli.console import progress
from fusionslam.cli.failures import needs_extra
from fusionslam.storage.progress import label_progress


@opt.options_of()
def merge(
    path: opt.MapFile,
    other: Annotated[
        Path, typer.Argument(metavar="OTHER", help="The map that is taken in; it stays as it is.")
    ],
) -> None:
    """Take the sessions of OTHER into MAP, if three loops between both agree.

    Else nothing changes, the loops are listed, and the exit status is 1.
    """
    needs_extra("map")
    from fusionslam.errors import ConfigError
    from fusionslam.mapping import PlaceMap

    if path.exists() and other.exists() and path.samefile(other):
        raise ConfigError(
            f"MAP {path} and OTHER {other} are the same file: expected two maps",
            code="same-file",
            fields=(str(path), str(other)),
        )
    with PlaceMap.open(path) as site:
        with progress() as step:
            done = site.merge(other, progress=label_progress(step, "comparing keyframes"))
        if done.reason is None:
            print(f"{', '.join(done.sessions)}: {len(done.believed)} loops join the maps")
            print(site.describe())
            return
    print(f"not merged: {done.reason}")
    for edge in done.refused:
        print(f"keyframe {edge.a} and {edge.b} of {other}: {edge.reason}")
    raise typer.Exit(1)
