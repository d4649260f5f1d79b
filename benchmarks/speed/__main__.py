# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""How long our functions take, beside named peers: ``make bench``."""

import os
import tempfile
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

# Before NumPy is imported, which reads them once.
for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[variable] = "1"

WIDTH = 200  # of the tables where there is no terminal


def main(
    quick: Annotated[
        bool, typer.Option("--quick", help="Small sizes, to see that everything works.")
    ] = False,
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", help="Folder for JSON and pictures. [out/bench]"),
    ] = None,
    only: Annotated[
        list[str] | None, typer.Option(help="A part to measure; repeat for more.")
    ] = None,
    write: Annotated[
        bool, typer.Option("--write", help="Rewrite docs/results/performance.md.")
    ] = False,
) -> None:
    """Measure, compare the answers, print tables, write JSON and pictures."""
    from benchmarks.speed import report, run

    unknown = set(only or ()) - set(run.PARTS)
    if unknown:
        raise typer.BadParameter(f"{', '.join(unknown)}: expected some of {', '.join(run.PARTS)}")
    if write and (quick or only):
        raise typer.BadParameter("--write needs a full run, without --quick and --only")
    console = Console()
    if not console.is_terminal:
        console.width = WIDTH
    with tempfile.TemporaryDirectory() as scratch, console.status("") as status:
        found = run.benchmark(
            only or run.PARTS,
            Path(scratch),
            quick=quick,
            step=status.update if console.is_terminal else console.print,
        )
        folder = output or (Path(scratch) / "results" if quick else Path("out/bench"))
        report.store(found, folder)
        report.show(found, console)
    console.print(f"{found.seconds:.0f} s")
    if found.wrong:
        for result in found.wrong:
            console.print(f"[red]wrong answer:[/] {result.name}: {result.wrong}")
        raise typer.Exit(1)
    if write:
        report.write_page(found, folder)
        console.print(f"{report.PAGE}")


if __name__ == "__main__":
    typer.run(main)
