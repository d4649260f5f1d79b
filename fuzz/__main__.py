# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The command line: ``python -m fuzz``."""

import os
from pathlib import Path
from typing import Annotated

import typer
from rich.progress import Progress

from fuzz.results import write_table
from fuzz.supervisor import CORE, Outcome, core_targets, run_targets
from fuzz.targets import all_targets


def main(
    inputs: Annotated[int, typer.Option(help="Inputs for each target.")] = 20_000,
    core_inputs: Annotated[
        int | None, typer.Option(help="Inputs for each target of the C++ core, which are quick.")
    ] = None,
    target: Annotated[
        list[str] | None, typer.Option(help="Target or group (before the slash); default: all.")
    ] = None,
    jobs: Annotated[int, typer.Option(help="Targets run at a time.")] = os.cpu_count() or 1,
    seed: Annotated[int, typer.Option(help="Of the generator; 0 for another one each time.")] = 1,
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder.")] = Path("out/fuzz"),
    resume: Annotated[
        bool, typer.Option("--resume", help="Count the inputs that the folder holds.")
    ] = False,
    write: Annotated[
        bool,
        typer.Option(
            "--write", help="Write these rows of the table in docs/results/robustness.md."
        ),
    ] = False,
) -> None:
    """Try hostile inputs; ends with 1 if there is a finding."""
    known = [*all_targets(), *core_targets()]
    names = [name for name in known if not target or {name, name.partition("/")[0]} & {*target}]
    if not names:
        raise typer.BadParameter(f"no target is named {', '.join(target or ())}")
    wanted = {name: core_inputs or inputs if name.startswith(CORE) else inputs for name in names}
    done: list[Outcome] = []
    with Progress() as progress:
        bar = progress.add_task("targets", total=len(names))
        for outcome in run_targets(wanted, output.resolve(), jobs=jobs, seed=seed, resume=resume):
            done.append(outcome)
            progress.advance(bar)
            progress.console.print(describe(outcome))
    bad = [path for outcome in done for path in outcome.findings]
    print(f"{sum(outcome.inputs for outcome in done)} inputs, {len(bad)} findings")
    short = [outcome.target for outcome in done if outcome.inputs < wanted[outcome.target]]
    if short:
        print("ended before all inputs were tried:", ", ".join(short))
    if write:
        write_table(done)
    raise typer.Exit(1 if bad or short else 0)


def describe(outcome: Outcome) -> str:
    """One line on an outcome, and its findings."""
    return "\n  ".join(
        [
            f"{outcome.target}: {outcome.inputs} inputs, {outcome.accepted} accepted, "
            f"{outcome.crashes} crashes, {outcome.hangs} hangs, {outcome.memory} over memory, "
            f"{outcome.silent} silent, {outcome.untyped} untyped",
            *outcome.findings,
        ]
    )


if __name__ == "__main__":
    typer.run(main)
