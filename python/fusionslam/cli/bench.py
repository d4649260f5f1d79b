# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The command bench: descriptors compared on a recording."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from fusionslam.cli import options as opt
from fusionslam.cli.console import print_summary, progress
from fusionslam.cli.failures import keep, needs_extra
from fusionslam.cli.recordings import build_recording

if TYPE_CHECKING:
    from fusionslam.pipelines.describe import PipelineConfig
    from fusionslam.pipelines.recording import Recording
    from fusionslam.storage.progress import Step


def compare(
    recording: "Recording",
    output: Path,
    descriptors: "Sequence[str] | Mapping[str, Sequence[str]]",
    configs: "dict[str, PipelineConfig]",
    *,
    skip_bad_frames: opt.SkipBad = False,
    jobs: opt.Jobs = None,
    no_report: bool = False,
    demo: bool = False,
    before_report: "Callable[[Step], Sequence[str]] | None" = None,
) -> None:
    """Compare descriptors, write the report, or only its figures, and print its tables.

    What ``before_report`` returns is printed after the tables.
    """
    from fusionslam.pipelines.compare_descriptors import benchmark
    from fusionslam.pipelines.results import delete_page
    from fusionslam.report.loops.stored import write_stored_metrics, write_stored_report

    first = next(iter(configs.values()))
    opt.warn_of_windows(first)
    protocol = first.evaluation.protocol
    with progress() as step:
        evaluations = benchmark(
            recording,
            output,
            descriptors,
            configs=configs,
            jobs=opt.cores(jobs),
            bad_frames=opt.bad_frames(skip_bad_frames),
            command=opt.command_line(),
            step=step,
            demo=demo,
        )
        closing = before_report(step) if before_report else ()
        if no_report:
            delete_page(output, "report")
            page = write_stored_metrics(output, evaluations, command=opt.command_line())
        else:
            step("writing the report", 0, 1)
            page = write_stored_report(output, evaluations, protocol=protocol)
            step("writing the report", 1, 1)
    print_summary(evaluations, protocol)
    for line in closing:
        print(line)
    print(page)


@opt.options_of(
    build_recording=build_recording, pipeline_config=opt.pipeline_config, compare=compare
)
def bench(
    ctx: typer.Context,
    output: opt.Folder = Path("out/bench"),
    descriptors: opt.Names = "usual",
    source: opt.Sources = None,
    protocol: opt.Protocol = None,
    *,
    build_recording: "Callable[[], Recording]",
    pipeline_config: "Callable[[], PipelineConfig]",
    compare: Callable[..., None],
    no_report: opt.NoReport = False,
) -> None:
    """Compare descriptors on DATA: accuracy, time, memory.

    Every source of clouds that the data allow is compared. Figures published under the protocol
    for the same sequence of KITTI are shown beside those measured.
    """
    from fusionslam.config import merged

    if not no_report:
        needs_extra("report", unless="--no-report")
    chosen = pipeline_config()
    if protocol is not None:
        chosen = merged(chosen, {"evaluation": {"protocol": protocol}})
    names = opt.parse_names(descriptors, chosen.descriptors.preset)
    recording = build_recording()
    given = source is not None or "source" in chosen.fusion.model_fields_set
    sources = (opt.choose_source(source, chosen, recording),) if given else recording.sources()
    keep(ctx, output)
    configs = dict.fromkeys(sources, chosen)
    compare(recording, output, names, configs, no_report=no_report)
