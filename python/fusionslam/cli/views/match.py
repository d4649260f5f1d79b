# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The command views match: the id of each scan's place."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from fusionslam.cli import options as opt
from fusionslam.cli.console import progress
from fusionslam.cli.failures import needs_extra
from fusionslam.cli.recordings import build_recording, open_scenes
from fusionslam.cli.views.tables import print_run
from fusionslam.storage.progress import label_progress

if TYPE_CHECKING:
    from fusionslam.evaluation import ViewRun
    from fusionslam.pipelines.recording import Recording
    from fusionslam.pipelines.views import MatchRun
    from fusionslam.views.scene_set import SceneSet

OdometryName = Literal["recorded", "drift", "none"]


@opt.options_of(
    build_recording=build_recording, views_config=opt.views_config, open_scenes=open_scenes
)
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
    build_recording: "Callable[[], Recording]",
    views_config: Callable[[], Any],
    open_scenes: "Callable[..., SceneSet]",
    no_report: opt.NoReport = False,
) -> None:
    """Give each scan the id of its place, as on a robot; judge the ids if true poses are known."""
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
    _save_figures(output / "matches.json", run, values)
    print_run(run, None if judged is None else judged.judge(rule))
    if judged is None or no_report:
        delete_page(output, "views")
        print(output / "matches.csv")
    else:
        print(_write_report(judged, output, rule))


def _write_report(judged: "ViewRun", output: Path, rule: str) -> Path:
    from fusionslam.report.views.page import write_view_report

    return write_view_report(judged, output, rule=rule, command=opt.command_line())


def _save_figures(path: Path, run: "MatchRun", values: dict[str, Any]) -> None:
    import json
    from dataclasses import asdict

    from fusionslam.storage.files import atomic_path

    content = {
        "scenes": run.scenes.name,
        "command": opt.command_line(),
        "threshold": run.threshold,
        "stats": {**asdict(run.stats), "bytes_per_view": run.stats.bytes_per_view},
        "views": values,
    }
    with atomic_path(path) as temporary:
        temporary.write_text(json.dumps(content, indent=1), encoding="utf-8")
