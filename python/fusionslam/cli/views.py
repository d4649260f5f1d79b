# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The commands ``fusionslam views ...``."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from fusionslam.base.progress import label_progress
from fusionslam.base.texts import counted
from fusionslam.cli import options as opt
from fusionslam.cli import views_train
from fusionslam.cli.console import print_table, progress
from fusionslam.cli.failures import needs_extra
from fusionslam.cli.recordings import (
    BuildRecording,
    OpenScenes,
    build_recording,
    open_scenes,
)

if TYPE_CHECKING:
    from fusionslam.pipelines.recording import Recording
    from fusionslam.views.scene_set import SceneSet

app = typer.Typer(
    help="Recognise places by aligning scans, or by objects or descriptors.",
    no_args_is_help=True,
    rich_markup_mode=None,
)
app.add_typer(views_train.app, name="train")


OdometryName = Literal["recorded", "drift", "none"]


@app.command()
@opt.command
def record(
    output: Annotated[Path, typer.Option("--output", "-o", help="The scene set, a .npz.")],
    features: Annotated[
        str, typer.Option("--features", metavar="NAMES", help="Descriptors to store as well.")
    ] = "",
    only_scenes: Annotated[
        bool, typer.Option("--only-scenes", help="Store scenes as configured, but no clouds.")
    ] = False,
    *,
    build_recording: BuildRecording,
    views_config: opt.ViewsConfigOf,
    open_scenes: Annotated[Callable[..., "SceneSet"], partial(open_scenes, skip_empty=False)],
) -> None:
    """Record DATA as a scene set: clouds without ground, true poses, descriptors."""
    from dataclasses import replace

    from fusionslam.views.recognisers import scene_config

    whole = views_config()
    names = opt.parse_names(features) if features else []
    target = output if output.suffix == ".npz" else output.with_name(f"{output.name}.npz")
    opt.check_output(target, build_recording, views_config)
    recording = build_recording()
    with progress() as step:
        scenes = open_scenes(recording, whole, step, features=names)
        if only_scenes:
            made = scene_config(whole.views)
            scenes = scenes.with_scenes(made, label_progress(step, "building")).without_clouds()
    replace(scenes, source={**scenes.source, "command": opt.command_line()}).save(target)
    truth = ", no true poses" if scenes.poses is None else ""
    print(f"{target}: {counted(len(scenes), 'scan')}, {int(scenes.empty.sum())} empty{truth}")


@app.command()
@opt.command
def match(
    output: opt.Folder = Path("out/views-match"),
    rule: opt.Rule = "paper",
    odometry: Annotated[
        OdometryName | None,
        typer.Option(
            help="Weigh stored views by odometry (alignment only): recorded is the default where "
            "there is any; drift simulates it from true poses, 2 % too long, turns 1 % too wide; "
            "none compares single scans."
        ),
    ] = None,
    *,
    build_recording: BuildRecording,
    views_config: opt.ViewsConfigOf,
    open_scenes: OpenScenes,
    no_report: opt.NoReport = False,
) -> None:
    """Give each scan the id of its place, as on a robot; judge the ids if true poses are known."""
    from fusionslam.cli.view_tables import print_run, save_figures
    from fusionslam.pipelines.results import delete_page, refuse_input
    from fusionslam.pipelines.views import odometry_of, run_views
    from fusionslam.views.matcher import ViewMatcher
    from fusionslam.views.recognisers import describe_method, settle_method

    whole = views_config()
    matcher = ViewMatcher(whole.views, fusion=whole.fusion, descriptors=whole.descriptors)
    recording = build_recording()
    refuse_input(recording, output)
    with progress() as step:
        scenes = open_scenes(recording, whole, step)
        views = settle_method(whole.views, colored=scenes.has_colors, name=scenes.name)
        if views is not whole.views:
            matcher = ViewMatcher(views, fusion=whole.fusion, descriptors=whole.descriptors)
        if scenes.poses is not None and not no_report:
            needs_extra("report", unless="--no-report")
        poses = odometry_of(scenes, matcher, odometry)
        run = run_views(scenes, matcher, label_progress(step, "matching"), odometry=poses)
    values = matcher.config.model_dump(mode="json")
    title = describe_method(matcher.config)
    judged = None if scenes.poses is None else run.with_truth(title, values)
    run.save(output / "matches.csv")
    matcher.save(output / "matcher.npz")
    save_figures(output / "matches.json", run, values, opt.command_line())
    print_run(run, None if judged is None else judged.judge(rule))
    if judged is None or no_report:
        delete_page(output, "views")
        print(output / "matches.csv")
    else:
        from fusionslam.report.views.page import write_view_report

        print(write_view_report(judged, output, rule=rule, command=opt.command_line()))


@app.command()
@opt.command
def curve(
    output: opt.Folder = Path("out/views-curve"),
    rule: opt.Rule = "paper",
    loop_precision: Annotated[
        float,
        typer.Option("--loop-precision", min=0, max=1, help="Least loop precision of a threshold."),
    ] = 0.97,
    *,
    build_recording: BuildRecording,
    views_config: opt.ViewsConfigOf,
    open_scenes: OpenScenes,
) -> None:
    """Judge the ids at many thresholds, and name the best ones."""
    from fusionslam.cli.view_tables import HEADS, curve_row, print_limits, without_sensor
    from fusionslam.pipelines.results import refuse_input
    from fusionslam.pipelines.views import sweep_thresholds
    from fusionslam.views.recognisers import settle_method

    whole = views_config()
    recording = build_recording()
    refuse_input(recording, output)
    with progress() as step:
        scenes = open_scenes(recording, whole, step)
        found = sweep_thresholds(
            scenes,
            settle_method(whole.views, colored=scenes.has_colors, name=scenes.name),
            descriptors=whole.descriptors,
            rule=rule,
            progress=label_progress(step, "matching"),
        )
    found.save(output / "curve.json")
    best = {
        "most accurate": found.most_accurate_threshold(),
        f"loop precision {loop_precision:.0%}": found.best_threshold(loop_precision),
    }
    rows = [curve_row(found, *item) for item in best.items()]
    rows += [[name, "", *shares] for name, *shares in without_sensor(scenes, rule)]
    print_table(["", "threshold", *HEADS], rows)
    print_limits(scenes, rule)
    print(output / "curve.json")


@app.command()
@opt.command
def show(
    frame: Annotated[
        int, typer.Option("--frame", metavar="N", help="Number of the scan, as in matches.csv.")
    ],
    output: Annotated[Path, typer.Option("--output", "-o", help="The picture, a .png.")],
    against: Annotated[
        int | None,
        typer.Option("--against", metavar="M", help="Number of a scan to compare it with."),
    ] = None,
    *,
    build_recording: Annotated[Callable[[], "Recording"], partial(build_recording, gt=None)],
    views_config: opt.ViewsConfigOf,
) -> None:
    """Draw a scan and its objects, or the matching objects of two scans."""
    from fusionslam.cli.data import open_data
    from fusionslam.errors import ConfigError
    from fusionslam.pipelines import scenes
    from fusionslam.report.views.scene_figures import write_pair_picture, write_scene_picture
    from fusionslam.views import recognisers
    from fusionslam.views.clusters import ClusteredScan, cluster_scan

    if output.suffix.lower() != ".png":
        raise ConfigError(f"--output is {output}, expected the name of a .png")
    needs_extra("report", module="matplotlib")
    opt.check_output(output, build_recording, views_config)
    dataset, whole = open_data(build_recording(), views_config())

    def scan(number: int) -> ClusteredScan:
        cloud = scenes.record_cloud(dataset, number, fusion=whole.fusion, recording=whole.recording)
        return cluster_scan(number, cloud, recognisers.scene_config(whole.views))

    if against is None:
        write_scene_picture(output, scan(frame))
    else:
        similarity = recognisers.similarity_config(whole.views)
        is_aligned = recognisers.method_of(whole.views) == "alignment"
        alignment = recognisers.alignment_config(whole.views) if is_aligned else None
        write_pair_picture(output, scan(frame), scan(against), similarity, alignment)
    print(output)
