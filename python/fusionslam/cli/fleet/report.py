# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The command fleet report: a page about the places of a fleet."""

from pathlib import Path
from typing import Annotated

import typer

from fusionslam.cli import options as opt
from fusionslam.cli.console import progress
from fusionslam.cli.failures import needs_extra
from fusionslam.cli.fleet.options import Places, open_folder
from fusionslam.storage.progress import Step, label_progress


@opt.options_of()
def report(
    places: Places,
    most: Annotated[
        int,
        typer.Option(
            "--asked", min=0, help="Places of each drive that are looked for in all others."
        ),
    ] = 10,
) -> None:
    """Write a page: recordings, failures, sites, and which drives came by the same places."""
    with progress() as step:
        page = write_page(places, most, step)
    print(page)


def write_page(places: Path, most: int, step: Step) -> Path:
    """Write the page of a folder of places; return its path."""
    needs_extra("report")
    needs_extra("map")
    folder = open_folder(places)
    from fusionslam.fleet.encounters import find_encounters
    from fusionslam.fleet.work import Plan, list_status
    from fusionslam.report.fleet import write_fleet_page

    status = list_status(places)
    with folder.database() as database:
        encounters = find_encounters(
            folder,
            database,
            Plan.load(places),
            most=most,
            progress=label_progress(step, "looking for drives in each other"),
        )
        return write_fleet_page(
            places / "fleet.html",
            folder,
            database,
            status,
            encounters,
            command=opt.command_line(),
        )
