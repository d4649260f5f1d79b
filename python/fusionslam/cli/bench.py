# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The command bench: descriptors compared on a recording."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from fusionslam.cli import options as opt
from fusionslam.cli.console import print_summary, progress
from fusionslam.cli.failures import keep, needs_extra
from fusionslam.storage.progress import Step

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from fusionslam.pipelines.describe import PipelineConfig
    from fusionslam.pipelines.recording import Recording


@opt.reading_options()
def bench(
    ctx: typer.Context,
    *,
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder for the results.")] = Path(
        "out/bench"
    ),
    descriptors: opt.Names = "all",
    source: opt.Sources = None,
    recording: "Recording",
    skip_bad_frames: opt.SkipBad = False,
    settings: opt.Settings = None,
    config: opt.ConfigFile = None,
    jobs: opt.Jobs = None,
    verbose: opt.Verbose = False,
) -> None:
    """Compare descriptors on DATA: accuracy, time, memory.

    Every source of clouds that the data allow is compared.
    """
    needs_extra("report")
    names = opt.names_of(descriptors)
    chosen = opt.pipeline_config(config, settings)
    given = source is not None or "source" in chosen.fusion.model_fields_set
    sources = (opt.source_of(source, chosen, recording),) if given else recording.sources()
    keep(ctx, output)
    with progress() as step:
        compare(
            recording,
            output,
            names,
            dict.fromkeys(sources, chosen),
            opt.cores(jobs),
            step,
            bad_frames=opt.bad_frames(skip_bad_frames),
        )


def compare(
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
