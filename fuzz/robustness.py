# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What a robot's files and its service meet, in numbers: ``python -m fuzz.robustness --write``.

``--row NAME`` runs one row of the table in docs/results/robustness.md, ``--count N`` with another
number of inputs.
"""

import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from benchmarks.accuracy.markdown import read_rows, table, write_between
from fuzz import PROJECT
from fuzz.results import PAGE


@dataclass(frozen=True)
class Result:
    """A row of the table.

    Attributes:
        inputs: number of them.
        bad: number of those that ended as nothing should, which is to be at most the bound.
        found: what came of them, in words.
    """

    inputs: int
    bad: int
    found: str


@dataclass(frozen=True)
class Row:
    """A check of the table: what it runs, its usual number of inputs and the most bad ends."""

    title: str
    run: Callable[[int], Result]
    count: int
    bound: int = 0


def flip(count: int) -> Result:
    """Flip bits of all formats, so many altogether."""
    from fuzz.bit_flips import DATABASES, FORMATS, flip_bits, random_bits

    formats = FORMATS | DATABASES
    tried = refused = silent = missed = 0
    for name, form in formats.items():
        with tempfile.TemporaryDirectory() as folder:
            bits = random_bits(-(-count // len(formats)))
            flips = flip_bits(form, Path(folder), bits)
        print(f"{name}: {flips}", flush=True)
        tried += flips.tried
        refused += flips.refused
        silent += len(flips.silent)
        missed += len(flips.missed)
    text = f"{len(formats)} formats: {refused:,} refused, {silent} silent, {missed} not found by"
    return Result(tried, silent + missed, f"{text} `check`; the others changed nothing")


def craft(count: int) -> Result:
    """Read each of the first crafted files in a process of its own."""
    from fuzz.crafted_files import CRAFTED, read_in_a_process

    names = list(CRAFTED)[:count]
    ends = {name: read_in_a_process(CRAFTED[name]) for name in names}
    for name, end in ends.items():
        print(f"{name}: {end}", flush=True)
    bad = [end for end in ends.values() if not end.is_good]
    seconds = max(end.seconds for end in ends.values())
    memory = max(end.megabytes for end in ends.values())
    text = f"{len(bad)} not refused in time and memory; longest {seconds:.2f} s, most {memory} MB"
    return Result(len(ends), len(bad), text)


def change(count: int) -> Result:
    """Change files of maps under their writers at random moments."""
    from fuzz.changed_files import change_at_random_moments

    ends = change_at_random_moments(count, seed=3)
    for (how, end), times in sorted(ends.items()):
        print(f"{how}: {times} {end}", flush=True)
    lost = sum(times for (_, end), times in ends.items() if end in ("lost", "false alarm"))
    told = sum(times for (_, end), times in ends.items() if end == "told")
    text = f"{lost} lost without a word or refused without a reason; {told:,} refused in words"
    return Result(ends.total(), lost, f"{text}, the others kept all")


def besiege(count: int) -> Result:
    """Let idle, slow and greedy clients take the service, for so many seconds."""
    from fuzz.siege import besiege_service

    siege = besiege_service(count)
    ratio = siege.during_ms / siege.alone_ms
    bad = siege.wrong + (ratio > 3)
    text = f"p95 {siege.alone_ms:.0f} ms alone, {siege.during_ms:.0f} ms during ({ratio:.1f} times)"
    return Result(siege.answers, bad, f"{text}, {siege.wrong} wrong answers; {siege.front}")


def leave(count: int) -> Result:
    """End processes while daemon threads are in the core."""
    from fuzz.exits import WORKS, exit_in_the_core

    wrong = exit_in_the_core(count)
    return Result(count, len(wrong), f"{len(wrong)} with another status; {len(WORKS)} functions")


def call(count: int) -> Result:
    """Call public names with values of any type."""
    firsts = range(0, count, CALLS_OF_A_PROCESS)
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        counts = [min(CALLS_OF_A_PROCESS, count - first) for first in firsts]
        bad = sum(pool.map(_call, firsts, counts))
    return Result(count, bad, f"{bad} NaN, hangs or errors of other types")


def _call(seed: int, count: int) -> int:
    command = [sys.executable, "-m", "fuzz.any_arguments", str(count), f"--seed={seed}"]
    run = subprocess.run(command, cwd=PROJECT, capture_output=True, text=True)
    found = re.search(r"calls, (\d+) answers", run.stdout)
    if not found:
        raise RuntimeError(f"{command} ended early:\n{run.stderr[-2000:]}")
    print(run.stdout, flush=True)
    return int(found[1])


CALLS_OF_A_PROCESS = 20_000
ROWS: Mapping[str, Row] = {
    "flips": Row("flipped bits of stored data", flip, 10_000),
    "crafted": Row("crafted files, each with 200 MB and 1 s of processor time", craft, 75),
    "moments": Row("maps replaced, removed, restored, flipped, killed or forked", change, 1000),
    "siege": Row("1,000 idle, 200 slow, 128 greedy clients beside 16 good ones", besiege, 20),
    "exits": Row("exits with daemon threads in the C++ core", leave, 504),
    "calls": Row("calls with arguments of any type", call, 200_000, bound=50),
}


def main(
    row: Annotated[list[str] | None, typer.Option(help=f"{', '.join(ROWS)}; default: all.")] = None,
    count: Annotated[int | None, typer.Option(min=1, help="Inputs; of siege, seconds.")] = None,
    write: Annotated[
        bool, typer.Option("--write", help="Write these rows in docs/results/robustness.md.")
    ] = False,
) -> None:
    """Run rows of the table; ends with 1 if one is above its bound."""
    is_bad = False
    for name in row or ROWS:
        one = ROWS[name]
        result = one.run(count or one.count)
        is_bad |= result.bad > one.bound
        print(f"{one.title}: {result}", flush=True)
        if write:
            write_row(one, result)
    raise typer.Exit(is_bad)


def write_row(row: Row, result: Result) -> None:
    """Write a row of the page; those of other checks stay."""
    cells = {one[0]: one for one in read_rows(PAGE, "robustness")}
    cells[row.title] = [
        row.title,
        *(f"{number:,}" for number in (result.inputs, result.bad, row.bound)),
        result.found,
    ]
    titles = [one.title for one in ROWS.values() if one.title in cells]
    header = ["check", "inputs", "bad", "at most", "found"]
    write_between(PAGE, "robustness", table(header, [cells[title] for title in titles]))


if __name__ == "__main__":
    typer.run(main)
