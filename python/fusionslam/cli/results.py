# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Commands that compare and judge: demo, bench, eval, report."""

from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from fusionslam.cli import options as opt
from fusionslam.cli.console import Step, print_summary, progress
from fusionslam.cli.failures import keep, keep_parts, needs_extra

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from fusionslam.pipelines.describe import PipelineConfig
    from fusionslam.pipelines.recording import Recording


def demo(
    ctx: typer.Context,
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder for the results.")] = Path(
        "out/demo"
    ),
    world: Annotated[
        str, typer.Option("--world", help="town (a car), or warehouse, house, hospital (a robot).")
    ] = "town",
    settings: opt.Settings = None,
    config: opt.ConfigFile = None,
    jobs: opt.Jobs = None,
    verbose: opt.Verbose = False,
) -> None:
    """Compare all descriptors on a simulated drive; needs no data.

    --set sim.KEY changes the simulation: what config sim prints for the town, what the command
    sim takes for the other worlds.
    """
    from fusionslam.pipelines.compare_descriptors import (
        DEMO,
        DEMO_DESCRIPTORS,
        INDOOR,
        INDOOR_DESCRIPTORS,
    )
    from fusionslam.sim.recordings import EMBEDDED

    opt.one_of("--world", world, ("town", *EMBEDDED))
    for extra in ("sim", "report") if world == "town" else ("sim", "bags", "report"):
        needs_extra(extra)
    own, others = _split_settings(settings)
    indoor = world != "town"
    descriptors = INDOOR_DESCRIPTORS if indoor else DEMO_DESCRIPTORS
    configs = {
        source: opt.pipeline_config(config, others, **(INDOOR if indoor else DEMO.get(source, {})))
        for source in descriptors
    }
    keep(ctx, output)
    with progress() as step:
        make = _robot_drive if indoor else _car_drive
        recording = make(world, config, own, output, opt.cores(jobs), step)
        # A robot before a wall, nearer than its LiDAR can see, has nothing to describe.
        bad = opt.bad_frames(indoor)
        _compare(
            recording,
            output,
            descriptors,
            configs,
            opt.cores(jobs),
            step,
            demo=True,
            bad_frames=bad,
        )


def bench(
    ctx: typer.Context,
    data: opt.Data,
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder for the results.")] = Path(
        "out/bench"
    ),
    descriptors: opt.Names = "all",
    source: opt.Sources = None,
    kind: opt.KindOption = None,
    sequence: opt.Sequence = None,
    topic: opt.Topics = None,
    stamps: opt.StampsOption = "header",
    sync: opt.SyncOption = None,
    calib: opt.Calibration = None,
    skip_gaps: opt.SkipGaps = False,
    skip_bad_frames: opt.SkipBad = False,
    gt: opt.Truth = None,
    settings: opt.Settings = None,
    config: opt.ConfigFile = None,
    jobs: opt.Jobs = None,
    verbose: opt.Verbose = False,
) -> None:
    """Compare descriptors on DATA: accuracy, time, memory.

    Every source of clouds that the data allow is compared.
    """
    needs_extra("report")
    recording = opt.recording_of(data, kind, sequence, skip_gaps, gt, topic, stamps, sync, calib)
    names = opt.names_of(descriptors)
    chosen = opt.pipeline_config(config, settings)
    given = source is not None or "source" in chosen.fusion.model_fields_set
    sources = (opt.source_of(source, chosen, recording),) if given else recording.sources()
    keep(ctx, output)
    with progress() as step:
        _compare(
            recording,
            output,
            names,
            dict.fromkeys(sources, chosen),
            opt.cores(jobs),
            step,
            bad_frames=opt.bad_frames(skip_bad_frames),
        )


def evaluate(
    folder: opt.Results,
    gt: opt.Truth = None,
    protocol: opt.Protocol = None,
    radius: opt.Radius = None,
    window: opt.Window = None,
    verbose: opt.Verbose = False,
) -> None:
    """Judge the runs in OUT against true poses.

    Writes metrics.json there.
    """
    from fusionslam.pipelines.compare_descriptors import stored_evaluations
    from fusionslam.report.loops.stored import write_stored_metrics

    _check_protocol(protocol)
    given = {"protocol": protocol, "radius": radius, "window": window}
    changes = {key: value for key, value in given.items() if value is not None}
    with progress() as step:
        evaluations, config = stored_evaluations(folder, changes, gt, step)
    path = write_stored_metrics(folder, evaluations, command=opt.command_line())
    print_summary(evaluations, config.protocol)
    print(path)


def report(
    ctx: typer.Context,
    folder: opt.Results,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Folder for the report; else OUT.")
    ] = None,
    protocol: opt.Protocol = None,
    verbose: opt.Verbose = False,
) -> None:
    """Write report.html for the runs in OUT, and views.html for runs of views.

    It has pictures of frames if the recording is still there.
    """
    from fusionslam.pipelines.compare_descriptors import stored_evaluations
    from fusionslam.pipelines.describe import run_files
    from fusionslam.pipelines.results import runs_folder
    from fusionslam.report import has_view_runs, write_stored_view_report
    from fusionslam.report.loops.stored import write_stored_report

    needs_extra("report")
    _check_protocol(protocol)
    if has_view_runs(folder):
        keep_parts(ctx, output or folder)
        print(write_stored_view_report(folder, output))
        if not run_files(runs_folder(folder)):
            return
    with progress() as step:
        evaluations, config = stored_evaluations(folder, step=step)
        protocol = protocol or config.protocol
        keep_parts(ctx, output or folder)
        step("writing the report", 0, 1)
        page = write_stored_report(folder, evaluations, output=output, protocol=protocol)
        step("writing the report", 1, 1)
    print(page)


def _check_protocol(protocol: str | None) -> None:
    from fusionslam.evaluation import PROTOCOLS

    if protocol is not None:
        opt.one_of("--protocol", protocol, tuple(PROTOCOLS))


def _compare(
    recording: "Recording",
    output: Path,
    descriptors: "Sequence[str] | Mapping[str, Sequence[str]]",
    configs: "dict[str, PipelineConfig]",
    jobs: int,
    step: Step,
    demo: bool = False,
    bad_frames: str = "error",
) -> None:
    from fusionslam.pipelines.compare_descriptors import benchmark
    from fusionslam.report.loops.stored import write_stored_report

    first = next(iter(configs.values()))
    opt.warn_of_windows(first)
    protocol = first.evaluation.protocol
    evaluations = benchmark(
        recording,
        output,
        descriptors,
        configs=configs,
        jobs=jobs,
        bad_frames=bad_frames,
        command=opt.command_line(),
        step=step,
        demo=demo,
    )
    step("writing the report", 0, 1)
    page = write_stored_report(output, evaluations, protocol=protocol)
    step("writing the report", 1, 1)
    print_summary(evaluations, protocol)
    print(page)


def _split_settings(settings: list[str] | None) -> tuple[list[str], list[str]]:
    """Those of the simulator, and the others."""
    own = [setting for setting in settings or [] if setting.strip().startswith("sim.")]
    return own, [setting for setting in settings or [] if setting not in own]


def _car_drive(
    world: str, file: Path | None, settings: list[str], output: Path, jobs: int, step: Step
) -> "Recording":
    """The drive through the town: the embedded one, or, if it was configured, one of its own."""
    from fusionslam.config import with_file, with_settings
    from fusionslam.pipelines.recording import Recording
    from fusionslam.pipelines.results import forget_demo
    from fusionslam.sim import SimConfig, embedded_folder, record

    whole = opt.everything()
    whole = with_settings(whole if file is None else with_file(whole, file), settings)
    simulation: SimConfig = whole.sim  # type: ignore[attr-defined]
    folder = embedded_folder() if simulation == SimConfig() else output / "drive"
    recording = Recording.at(folder)
    forget_demo(output, recording)
    with _cache_can_move(folder == embedded_folder()):
        record(simulation, folder, jobs=jobs, progress=partial(step, "driving through the town"))
    return recording


def _robot_drive(
    world: str, file: Path | None, settings: list[str], output: Path, jobs: int, step: Step
) -> "Recording":
    """The drive of a robot through one of the other worlds, kept in the cache."""
    from fusionslam.config import with_settings
    from fusionslam.pipelines.recording import Recording
    from fusionslam.pipelines.results import forget_demo
    from fusionslam.sim.recordings import embedded_bag, embedded_config, embedded_path

    own = [setting.strip().removeprefix("sim.") for setting in settings]
    config = with_settings(embedded_config(world), own)
    recording = Recording.at(embedded_path(world, config))
    forget_demo(output, recording)
    with _cache_can_move(True):
        embedded_bag(world, config, jobs=jobs, progress=partial(step, f"driving: {world}"))
    return recording


@contextmanager
def _cache_can_move(cached: bool) -> "Iterator[None]":
    """Say how, where the user's cache cannot be written."""
    from fusionslam.errors import DataError

    try:
        yield
    except DataError as error:
        if not cached:
            raise
        hint = "the environment variable FUSIONSLAM_CACHE can name another folder"
        raise DataError(f"{error}; {hint}") from error
