# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The command fleet index: makes queries among many places fast."""

from typing import Annotated

import typer

from fusionslam.cli import options as opt
from fusionslam.cli.console import progress
from fusionslam.cli.fleet.options import Places, open_folder


@opt.options_of()
def index(
    places: Places,
    recall: Annotated[
        float,
        typer.Option(
            "--recall", help="Share of the ten nearest places that queries must find, measured."
        ),
    ] = 0.99,
    compact: Annotated[
        bool,
        typer.Option("--compact", help="Only take in what was added, and free the disk's space."),
    ] = False,
) -> None:
    """Build the index of a database, and measure its recall on the places themselves."""
    folder = open_folder(places)
    with folder.database(read_only=False) as database, progress() as step:

        def show(text: str) -> None:
            step(text, 0, 1)

        database.compact(renews=compact, progress=show)  # many small files are slow
        report = database.index if compact else database.build_index(recall=recall, progress=show)
        count = len(database)
    if report is None or not report.partitions:
        print(f"{count} places: so few are compared exactly, without an index")
        return
    if report.recall < recall:
        print(f"the recall asked for, {recall:g}, is not reached")
    print(
        f"{report.rows} places in {report.partitions} partitions, of which {report.nprobes} are "
        f"searched: recall {report.recall:.4f} of {report.queries} queries, {report.seconds:.0f} s"
    )
