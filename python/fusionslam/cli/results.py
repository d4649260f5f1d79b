# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Commands that compare and judge: demo, bench, eval, report."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from fusionslam.cli import options as opt
from fusionslam.cli.guard import keep, keep_parts, needs_extra
from fusionslam.cli.screen import Step, print_summary, progress

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from fusionslam.pipeline import PipelineConfig
    from fusionslam.sim import SimConfig
    from fusionslam.workspace import Recording


def demo(
    ctx: typer.Context,
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder for the results.")] = Path(
        "out/demo"
    ),
    settings: opt.Settings = None,
    config: opt.ConfigFile = None,
    jobs: opt.Jobs = None,
    verbose: opt.Verbose = False,
) -> None:
    """Compare all descriptors on a simulated drive; needs no data."""
    from fusionslam.bench import DEMO, DEMO_DESCRIPTORS
    from fusionslam.workspace import Recording, forget_demo

    for extra in ("sim", "report"):
        needs_extra(extra)
    own, others = _split_settings(settings)
    configs = {
        source: opt.pipeline_config(config, others, **DEMO.get(source, {}))
        for source in DEMO_DESCRIPTORS
    }
    keep(ctx, output)
    with progress() as step:
        simulation = _simulation(config, own)
        recording = Recording.at(_drive_folder(simulation, output))
        forget_demo(output, recording)
        _drive(simulation, Path(recording.path), opt.cores(jobs), step)
        _compare(recording, output, DEMO_DESCRIPTORS, configs, opt.cores(jobs), step, demo=True)


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
    recording = opt.recording_of(data, kind, sequence, skip_gaps, gt, topic, stamps, sync)
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
    from fusionslam.bench import stored_evaluations, write_stored_metrics

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
    """Write report.html for the runs in OUT.

    It has pictures of frames if the recording is still there.
    """
    from fusionslam.bench import stored_evaluations, write_stored_report

    needs_extra("report")
    _check_protocol(protocol)
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
    from fusionslam.bench import benchmark, write_stored_report

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


def _simulation(file: Path | None, settings: list[str]) -> "SimConfig":
    from fusionslam.config import with_file, with_settings

    whole = opt.everything()
    whole = with_settings(whole if file is None else with_file(whole, file), settings)
    simulation: SimConfig = whole.sim  # type: ignore[attr-defined]
    return simulation


def _drive_folder(simulation: "SimConfig", output: Path) -> Path:
    """The embedded drive's, or one beside the results if the simulator was configured."""
    from fusionslam.sim import SimConfig, embedded_folder

    return embedded_folder() if simulation == SimConfig() else output / "drive"


def _drive(simulation: "SimConfig", folder: Path, jobs: int, step: Step) -> None:
    """Record the drive unless it is there."""
    from fusionslam.errors import DataError
    from fusionslam.sim import embedded_folder, record

    def show(done: int, total: int) -> None:
        step("driving through the town", done, total)

    try:
        record(simulation, folder, jobs=jobs, progress=show)
    except DataError as error:
        if folder != embedded_folder().resolve():
            raise
        hint = "the environment variable FUSIONSLAM_CACHE can name another folder"
        raise DataError(f"{error}; {hint}") from error
