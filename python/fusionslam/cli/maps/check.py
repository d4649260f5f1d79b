# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The command map check: whether a map is whole."""

import typer

from fusionslam.cli import options as opt
from fusionslam.cli.failures import needs_extra


@opt.options_of()
def check(path: opt.MapFile) -> None:
    """Read a map whole; say what is damaged, with exit status 1."""
    needs_extra("map")
    from fusionslam.mapping import PlaceMap

    with PlaceMap.open(path, read_only=True) as site:
        problems = site.check()
        print(f"{path}: {len(site)} keyframes, {len(problems) or 'nothing'} damaged")
    for problem in problems:
        print(problem)
    if problems:
        raise typer.Exit(1)
