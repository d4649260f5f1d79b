# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The commands bench and bench views: descriptors and place recognisers compared."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from fusionslam.cli import options as opt
from fusionslam.cli.console import during, print_figures, print_table, progress
from fusionslam.cli.failures import WRITES_ALL, keep, needs_extra
from fusionslam.cli.recordings import BuildRecording, build_recording
from fusionslam.errors import ConfigError

if TYPE_CHECKING:
    from fusionslam.base.progress import Step
    from fusionslam.pipelines.describe import PipelineConfig
    from fusionslam.pipelines.recording import Recording


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
    from fusionslam.cli.summary import print_summary
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
            with during(step, "writing the report"):
                page = write_stored_report(output, evaluations, protocol=protocol)
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
    from fusionslam.cli.data import record_seed
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

            def show(label: str, done: int, total: int, name: str = name) -> None:
                step(f"{name}: {label}", done, total)

            found[name] = benchmark(
                recording,
                folder,
                descriptors,
                configs=chosen,
                jobs=opt.cores(jobs),
                bad_frames=opt.bad_frames(skip_bad_frames),
                command=command,
                step=show,
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


@opt.command
def bench(
    ctx: typer.Context,
    output: opt.Folder = Path("out/bench"),
    descriptors: opt.Names = "usual",
    source: opt.Sources = None,
    protocol: opt.Protocol = None,
    seeds: opt.Seeds = None,
    *,
    build_recording: BuildRecording,
    pipeline_config: opt.PipelineConfigOf,
    compare: Annotated[Callable[..., None], compare],
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
        from fusionslam.cli.data import check_seeds

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


@opt.command
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
    build_recording: Annotated["partial[Recording]", partial(build_recording, data=Path())],
    jobs: opt.Jobs = None,
    no_report: opt.NoReport = False,
) -> None:
    """Compare recognisers of places on DATA: accuracy, loops, bytes, time.

    The tables also show the figures of the thesis and of its program run again. Without DATA the
    recordings below FUSIONSLAM_TEST_DATA are compared, else drives through simulated worlds.
    """
    from fusionslam.cli.view_tables import print_bench, write_bench
    from fusionslam.config import merged
    from fusionslam.datasets.range_recording import RecordingConfig
    from fusionslam.pipelines.compare_views import bench_views as bench
    from fusionslam.pipelines.drives import FRAMES, open_drive
    from fusionslam.pipelines.methods import BASELINES, METHODS, find_method, method_names
    from fusionslam.sim.rendered_images import rendered_images
    from fusionslam.views.recognisers import RECOGNISERS

    if methods == "list":
        rows = [(name, (METHODS.get(name) or RECOGNISERS[name]).help) for name in method_names()]
        print_table(("method", "what it is"), rows)
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
    keep(ctx, output, WRITES_ALL)
    ranges = merged(RecordingConfig(), {"shapes": shapes})
    with progress() as step:
        drives = [
            open_drive(one, ranges=ranges, render=rendered_images, jobs=opt.cores(jobs), step=step)
            for one in recordings
        ]
        frames = list(FRAMES) if frame == "all" else [name for name in FRAMES if name == frame]
        results = bench(drives, wanted, frames=frames, jobs=opt.cores(jobs), step=step)
        pages = write_bench(output, drives, results, step, no_report=no_report)
    print_bench(drives, results)
    for page in pages:
        print(page)


def default_data() -> list[str]:
    """Return the default DATA: known recordings, else simulated worlds."""
    from fusionslam.pipelines.compare_views import find_recordings
    from fusionslam.sim.recordings import EMBEDDED

    return find_recordings() or list(EMBEDDED)
