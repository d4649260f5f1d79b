# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The command bench views: place recognisers compared."""

import textwrap
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from fusionslam.cli import options as opt
from fusionslam.cli.console import print_figures, progress
from fusionslam.cli.failures import keep_parts, needs_extra
from fusionslam.cli.recordings import build_recording
from fusionslam.errors import ConfigError
from fusionslam.help_texts import counted
from fusionslam.storage.progress import Step

if TYPE_CHECKING:
    from fusionslam.pipelines.compare_views import ViewResult
    from fusionslam.pipelines.drives import Drive
    from fusionslam.pipelines.recording import Recording

_WIDTH = 80


@opt.options_of(build_recording=partial(build_recording, data=Path()))
def bench_views(
    ctx: typer.Context,
    data: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="DATA",
            help="Recordings, scene sets, worlds, or town, warehouse, house, hospital.",
        ),
    ] = None,
    output: opt.Folder = Path("out/bench-views"),
    methods: Annotated[
        str,
        typer.Option(
            "--methods",
            "-m",
            metavar="NAMES",
            help="Names with commas; all: those of the tables; list: print them.",
        ),
    ] = "all",
    frame: Annotated[
        str,
        opt.one_of("--frame", names=(*opt.FRAMES, "all"), help="Frame of the clouds; or all."),
    ] = "robot",
    shapes: Annotated[
        str,
        opt.one_of("--shapes", names=opt.SHAPES, help="Shapes that rays hit, if DATA has both."),
    ] = "collision",
    *,
    build_recording: "partial[Recording]",
    jobs: opt.Jobs = None,
    no_report: opt.NoReport = False,
) -> None:
    """Compare recognisers of places on DATA: accuracy, loops, bytes, time.

    The tables also show the figures of the thesis and of its program run again. Without DATA the
    recordings below FUSIONSLAM_TEST_DATA are compared, else drives through simulated worlds.
    """
    from fusionslam.config import merged
    from fusionslam.datasets.range_recording import RecordingConfig
    from fusionslam.pipelines.compare_views import bench_views as bench
    from fusionslam.pipelines.drives import FRAMES, open_drive
    from fusionslam.pipelines.methods import BASELINES, METHODS, find_method
    from fusionslam.sim.rendered_images import rendered_images

    if methods == "list":
        print_methods()
        return
    wanted = list(METHODS) if methods == "all" else [name.strip() for name in methods.split(",")]
    for name in wanted:
        find_method(name, "--methods")
    # Accuracy alone says little, so every table includes the baselines without a sensor.
    wanted += [name for name in BASELINES if name not in wanted]
    if not no_report:
        needs_extra("report", unless="--no-report")
    paths = [Path(path) for path in data or default_data()]
    for name, value in build_recording.keywords.items():
        if name in ("sequence", "gt") and value is not None and len(paths) > 1:
            problem = f"it is for one recording, {len(paths)} are compared"
            raise ConfigError(f"--{name} {value}: {problem}")
    recordings = [build_recording(data=path) for path in paths]
    keep_parts(ctx, output)
    ranges = merged(RecordingConfig(), {"shapes": shapes})
    with progress() as step:
        drives = [
            open_drive(one, ranges=ranges, render=rendered_images, jobs=opt.cores(jobs), step=step)
            for one in recordings
        ]
        frames = list(FRAMES) if frame == "all" else [name for name in FRAMES if name == frame]
        results = bench(drives, wanted, frames=frames, jobs=opt.cores(jobs), step=step)
        pages = write(output, drives, results, step, no_report=no_report)
    show(drives, results)
    for page in pages:
        print(page)


def default_data() -> list[str]:
    """Return the default DATA: known recordings, else simulated worlds."""
    from fusionslam.pipelines.compare_views import find_recordings
    from fusionslam.sim.recordings import EMBEDDED

    return find_recordings() or list(EMBEDDED)


def print_methods() -> None:
    """Print the name of every method and what it does."""
    from fusionslam.cli.console import print_table
    from fusionslam.pipelines.methods import METHODS, method_names
    from fusionslam.views.recognisers import RECOGNISERS

    rows = [(name, (METHODS.get(name) or RECOGNISERS[name]).help) for name in method_names()]
    print_table(("method", "what it is"), rows)


def write(
    output: Path,
    drives: "Sequence[Drive]",
    results: "Sequence[ViewResult]",
    step: Step,
    *,
    no_report: bool = False,
) -> list[Path]:
    """Write Markdown, JSON and one page per frame; return the paths of the pages."""
    from fusionslam.pipelines.drives import FRAMES
    from fusionslam.pipelines.results import delete_page
    from fusionslam.report.views.comparison_tables import write_view_bench
    from fusionslam.report.views.page import write_view_report
    from fusionslam.storage.machine import machine, versions

    about = {"command": opt.command_line(), "versions": versions(), "machine": machine()}
    write_view_bench(output, results, {drive.name: drive.dropped for drive in drives}, about)
    frames = list(dict.fromkeys(result.frame for result in results))
    pages = [output / "views.md"]
    if no_report:
        for folder in (output, *(output / frame for frame in FRAMES)):
            delete_page(folder, "views")
        return pages
    for number, frame in enumerate(frames):
        step("writing the reports", number, len(frames))
        runs = [r.run for r in results if r.frame == frame and r.run is not None]
        if runs:
            folder = output if len(frames) == 1 else output / frame
            pages.append(write_view_report(runs, folder, command=opt.command_line()))
    step("writing the reports", len(frames), len(frames))
    return pages


def show(drives: "Sequence[Drive]", results: "Sequence[ViewResult]") -> None:
    """Print the tables, in 80 columns."""
    from fusionslam.report.views.comparison_tables import (
        LEGEND,
        accuracy_table,
        cost_table,
        groups,
        notes,
    )

    for heading, rows in groups(results):
        print_figures(heading, accuracy_table(rows))
        print_figures("", cost_table(rows))
        print()
    lines = [LEGEND]
    lines += [
        f"{drive.name}: {counted(drive.dropped, 'scan')} without anything above the floor left out"
        for drive in drives
        if drive.dropped
    ]
    for line in [*lines, *notes(results)]:
        print(textwrap.fill(line, _WIDTH, subsequent_indent="  "))
