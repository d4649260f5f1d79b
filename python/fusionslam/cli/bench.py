# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The command bench: descriptors compared on a recording."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from fusionslam.cli import options as opt
from fusionslam.cli.console import print_figures, print_summary, progress
from fusionslam.cli.failures import keep, needs_extra
from fusionslam.cli.recordings import build_recording, check_seeds, record_seed

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
    verify: opt.Verify = "one",
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
            verify=verify,
        )
        closing = before_report(step) if before_report else ()
        if no_report:
            delete_page(output, "report")
            command = opt.command_line()
            page = write_stored_metrics(output, evaluations, command=command, protocol=protocol)
        else:
            step("writing the report", 0, 1)
            page = write_stored_report(output, evaluations, protocol=protocol)
            step("writing the report", 1, 1)
    print_summary(evaluations, protocol)
    for line in closing:
        print(line)
    print(page)


def compare_worlds(
    data: Path,
    seeds: "Sequence[int]",
    output: Path,
    descriptors: "Sequence[str]",
    configs: "Callable[[Recording], dict[str, PipelineConfig]]",
    *,
    verify: str,
    skip_bad_frames: bool = False,
    jobs: int | None = None,
    no_report: bool = False,
) -> None:
    """Compare descriptors on drives through worlds of several seeds, and print mean and range.

    The results of each seed are kept in a folder of its own below ``output``.
    """
    from fusionslam.pipelines.compare_descriptors import benchmark
    from fusionslam.report.loops.comparison import tables_over, write_several
    from fusionslam.report.loops.stored import write_stored_metrics

    found = {}
    command = opt.command_line()
    with progress() as step:
        for seed in seeds:
            recording = record_seed(str(data), seed, jobs=opt.cores(jobs), step=step)
            chosen = configs(recording)
            config = next(iter(chosen.values()))
            protocol = config.evaluation.protocol
            folder, name = output / f"seed-{seed}", f"{data} {seed}"
            found[name] = benchmark(
                recording,
                folder,
                descriptors,
                configs=chosen,
                jobs=opt.cores(jobs),
                bad_frames=opt.bad_frames(skip_bad_frames),
                command=command,
                step=_of_world(step, name),
                verify=verify,
            )
            write_stored_metrics(folder, found[name], command=command, protocol=protocol)
        written = write_several(
            output,
            found,
            protocol=protocol,
            command=command,
            config=config.model_dump(mode="json"),
            page=not no_report,
        )
    for title, table in tables_over(found, protocol).items():
        print_figures(title, table)
    print(f"mean (lowest to highest) of {', '.join(found)}; protocol {protocol}")
    print(written)


def _of_world(step: "Step", name: str) -> "Step":
    return lambda label, done, total: step(f"{name}: {label}", done, total)


@opt.options_of(
    build_recording=build_recording, pipeline_config=opt.pipeline_config, compare=compare
)
def bench(
    ctx: typer.Context,
    output: opt.Folder = Path("out/bench"),
    descriptors: opt.Names = "usual",
    source: opt.Sources = None,
    protocol: opt.Protocol = None,
    seeds: opt.Seeds = None,
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

    def configs(recording: "Recording") -> "dict[str, PipelineConfig]":
        given = source is not None or "source" in chosen.fusion.model_fields_set
        one = (opt.choose_source(source, chosen, recording),) if given else recording.sources()
        return dict.fromkeys(one, chosen)

    if seeds is not None:
        wanted = opt.parse_seeds(seeds)
        data = check_seeds(build_recording)
        keep(ctx, output)
        options = opt.filled(compare)
        compare_worlds(data, wanted, output, names, configs, no_report=no_report, **options)
        return
    recording = build_recording()
    chosen_of = configs(recording)
    keep(ctx, output)
    compare(recording, output, names, chosen_of, no_report=no_report)
