# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Commands about views: views record, views match, views curve, and tune."""

import logging
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from fusionslam.cli import options as opt
from fusionslam.cli.console import Step, print_table, progress
from fusionslam.cli.failures import keep, needs_extra
from fusionslam.cli.views import train
from fusionslam.cli.views.tables import HEADS, curve_row, figures, print_run, without_sensor

if TYPE_CHECKING:
    from collections.abc import Sequence

    from fusionslam.evaluation import ViewRun
    from fusionslam.pipelines.views import MatchRun
    from fusionslam.views.matcher import ViewMatcherConfig
    from fusionslam.views.scene_set import SceneSet

logger = logging.getLogger(__name__)

app = typer.Typer(
    help="Recognise places by their objects.",
    no_args_is_help=True,
    rich_markup_mode=None,
)
app.add_typer(train.app, name="train")

Scenes = Annotated[
    Path,
    typer.Argument(
        metavar="DATA", help="A scene set, a .npz recording, or what the other commands call DATA."
    ),
]
SceneSets = Annotated[
    list[Path], typer.Argument(metavar="SCENES...", help="Scene sets or .npz recordings.")
]
Tuned = Annotated[
    str | None,
    typer.Option("--tuned", metavar="NAME", help="Values found by tune that come with fusionslam."),
]
SkipEmpty = Annotated[
    bool, typer.Option("--skip-empty", help="Leave out scans of which nothing is left.")
]
Rule = Annotated[str, typer.Option("--rule", help="How views are judged: paper or author.")]
Folder = Annotated[Path, typer.Option("--output", "-o", help="Folder for what is written.")]


@app.command()
def record(
    data: Scenes,
    output: Annotated[Path, typer.Option("--output", "-o", help="The scene set, a .npz.")],
    features: Annotated[
        str, typer.Option("--features", metavar="NAMES", help="Descriptors to keep, too.")
    ] = "",
    only_scenes: Annotated[
        bool, typer.Option("--only-scenes", help="Keep scenes as configured, no clouds: small.")
    ] = False,
    kind: opt.KindOption = None,
    sequence: opt.Sequence = None,
    topic: opt.Topics = None,
    stamps: opt.StampsOption = "header",
    sync: opt.SyncOption = None,
    calib: opt.Calibration = None,
    skip_gaps: opt.SkipGaps = False,
    gt: opt.Truth = None,
    tuned: Tuned = None,
    settings: opt.Settings = None,
    config: opt.ConfigFile = None,
    jobs: opt.Jobs = None,
    verbose: opt.Verbose = False,
) -> None:
    """Write what a robot saw as a scene set: clouds without ground, true poses, descriptors."""
    from dataclasses import replace

    from fusionslam.views.matcher import scene_config

    whole = whole_config(tuned, config, settings)
    names = opt.names_of(features) if features else []
    recording = (kind, sequence, skip_gaps, gt, topic, stamps, sync, calib)
    target = output if output.suffix == ".npz" else output.with_name(f"{output.name}.npz")
    with progress() as step:
        scenes = _scene_set(data, whole, step, recording, jobs=opt.cores(jobs), features=names)
        if only_scenes:
            made = scene_config(whole.views)
            scenes = scenes.with_scenes(made, _shown(step, "building")).without_clouds()
    replace(scenes, source={**scenes.source, "command": opt.command_line()}).save(target)
    print(f"{target}: {len(scenes)} scans, {int(scenes.empty.sum())} empty{_truth(scenes)}")


@app.command()
def match(
    data: Scenes,
    output: Folder,
    skip_empty: SkipEmpty = False,
    rule: Rule = "paper",
    kind: opt.KindOption = None,
    sequence: opt.Sequence = None,
    topic: opt.Topics = None,
    skip_gaps: opt.SkipGaps = False,
    gt: opt.Truth = None,
    tuned: Tuned = None,
    settings: opt.Settings = None,
    config: opt.ConfigFile = None,
    jobs: opt.Jobs = None,
    no_report: Annotated[
        bool, typer.Option("--no-report", help="Write no page, which takes a while.")
    ] = False,
    verbose: opt.Verbose = False,
) -> None:
    """Give each scan the id of its place, as on a robot; judge the ids where there is truth."""
    from fusionslam.pipelines.views import run_views
    from fusionslam.views.matcher import ViewMatcher

    whole = whole_config(tuned, config, settings)
    opt.one_of("--rule", rule, ("paper", "author"))
    matcher = ViewMatcher(whole.views, fusion=whole.fusion, descriptors=whole.descriptors)
    with progress() as step:
        scenes = _scene_set(
            data, whole, step, (kind, sequence, skip_gaps, gt, topic), jobs=opt.cores(jobs)
        )
        scenes = scenes.without_empty() if skip_empty else scenes
        if scenes.poses is not None and not no_report:
            needs_extra("report")
        run = run_views(scenes, matcher, _shown(step, "matching"))
    values = whole.views.model_dump(mode="json")
    judged = None if scenes.poses is None else run.with_truth(_method(whole.views), values)
    run.save(output / "matches.csv")
    matcher.save(output / "matcher.npz")
    _save_figures(output / "matches.json", run, values)
    print_run(run, None if judged is None else judged.judged(rule))
    if judged is None or no_report:
        print(output / "matches.csv")
    else:
        print(_written_report(judged, output, rule))


@app.command()
def curve(
    data: Scenes,
    output: Folder,
    skip_empty: SkipEmpty = False,
    rule: Rule = "paper",
    loop_precision: Annotated[
        float, typer.Option("--loop-precision", min=0, max=1, help="Demanded of a threshold.")
    ] = 0.97,
    kind: opt.KindOption = None,
    sequence: opt.Sequence = None,
    topic: opt.Topics = None,
    skip_gaps: opt.SkipGaps = False,
    gt: opt.Truth = None,
    tuned: Tuned = None,
    settings: opt.Settings = None,
    config: opt.ConfigFile = None,
    jobs: opt.Jobs = None,
    verbose: opt.Verbose = False,
) -> None:
    """Judge the ids at many thresholds, and name the best ones."""
    from fusionslam.pipelines.views import sweep_thresholds

    whole = whole_config(tuned, config, settings)
    opt.one_of("--rule", rule, ("paper", "author"))
    with progress() as step:
        scenes = _scene_set(
            data, whole, step, (kind, sequence, skip_gaps, gt, topic), jobs=opt.cores(jobs)
        )
        scenes = scenes.without_empty() if skip_empty else scenes
        found = sweep_thresholds(
            scenes,
            whole.views,
            descriptors=whole.descriptors,
            rule=rule,
            progress=_shown(step, "matching"),
        )
    found.save(output / "curve.json")
    best = {
        "most accurate": found.most_accurate_threshold(),
        f"loop precision {loop_precision:.0%}": found.best_threshold(loop_precision),
    }
    rows = [curve_row(found, *item) for item in best.items()]
    rows += [[name, "", *shares] for name, *shares in without_sensor(scenes, rule)]
    print_table(["", "threshold", *HEADS], rows)
    print(output / "curve.json")


def tune(
    ctx: typer.Context,
    scenes: SceneSets,
    output: Annotated[Path, typer.Option("--output", "-o", help="YAML for --config.")],
    skip_empty: SkipEmpty = False,
    tuned: Tuned = None,
    settings: opt.Settings = None,
    config: opt.ConfigFile = None,
    jobs: opt.Jobs = None,
    verbose: opt.Verbose = False,
) -> None:
    """Look for the parameters of the similarity that judge recorded drives best.

    A call that was interrupted goes on where it stopped, and comes to the same end.
    """
    from fusionslam.pipelines.tuning import tune as find
    from fusionslam.pipelines.tuning import write_tuned
    from fusionslam.pipelines.tuning_state import TuningState

    needs_extra("tune")
    whole = whole_config(tuned, config, settings)
    state = output.with_name(f"{output.name}.state")
    keep(ctx, state)
    with progress() as step:
        sets = [_scene_set(path, whole, step) for path in scenes]
        sets = [each.without_empty() for each in sets] if skip_empty else sets

        def show(done: int, total: int, best: float) -> None:
            step(f"tuning, best {best:.4f}", done, total)
            logger.info("generation %d of %d: best %.6f", done, total, best)

        result = find(
            sets,
            whole.views,
            whole.tuning,
            state=TuningState(state),
            jobs=opt.cores(jobs),
            progress=show,
        )
    write_tuned(output, result, whole.tuning, sets, opt.command_line())
    rows: list[list[str]] = []
    for each, report in zip(sets, result.reports, strict=True):
        rows += [[each.name, *figures(report)], *without_sensor(each, report.rule_name)]
    print_table(["", *HEADS], rows)
    print(f"{output}: value {result.value:.4f}")


def whole_config(
    tuned: str | None, file: Path | None, settings: list[str] | None, **first: Any
) -> Any:
    """All stages: clouds in the robot's frame without ground, ``first``, then what was found by
    tuning, the file, and the settings."""
    from fusionslam.config import merged, with_file, with_settings
    from fusionslam.fusion import ROBOT_FUSION
    from fusionslam.views.presets import tuned_path

    fusion = ROBOT_FUSION.model_dump(exclude_unset=True)
    whole = merged(opt.everything(), {"fusion": fusion, **first})
    for path in ([tuned_path(tuned)] if tuned else []) + ([file] if file else []):
        whole = with_file(whole, path)
    return with_settings(whole, settings or [])


def _shown(step: Step, label: str) -> Any:
    return lambda done, total: step(label, done, total)


def opened(data: Path, whole: Any, how: "Sequence[Any]" = ()) -> Any:
    """A stored set, a recording of ranges, or the dataset that the options name."""
    from fusionslam.datasets.range_recording import RangeRecording, is_recording
    from fusionslam.views.scene_set import SceneSet, is_scene_set

    if data.is_file() and is_scene_set(data):
        refuse_reading_options(data, "a scene set", how)
        return SceneSet.load(data)
    if data.is_file() and is_recording(data):
        refuse_reading_options(data, "a .npz recording", how)
        return RangeRecording.open(data, whole.recording.shapes)
    return opt.recording_of(data, *how).open(whole.fusion.source)


def _scene_set(
    data: Path,
    whole: Any,
    step: Step,
    how: "Sequence[Any]" = (),
    *,
    jobs: int = 1,
    features: "Sequence[str]" = (),
) -> "SceneSet":
    """A stored set, or one made of a recording."""
    from fusionslam.datasets.range_recording import RangeRecording
    from fusionslam.pipelines.scenes import record_scenes
    from fusionslam.views.scene_set import SceneSet

    found = opened(data, whole, how)
    if isinstance(found, SceneSet):
        return found
    from_ranges = isinstance(found, RangeRecording)
    settings = whole.recording if from_ranges else whole.fusion
    return record_scenes(
        found,
        fusion=whole.fusion,
        recording=whole.recording,
        features=features,
        descriptors=whole.descriptors,
        jobs=jobs,
        source={"path": str(data), "config": settings.model_dump(mode="json")},
        progress=_shown(step, "reading" if from_ranges else "fusing"),
    )


_READING = [
    "--kind",
    "--sequence",
    "--skip-gaps",
    "--gt",
    "--topic",
    "--stamps",
    "--sync",
    "--calib",
]
"""Options that say how other data are read, in the order of ``opt.recording_of``."""


def refuse_reading_options(data: Path, what: str, how: "Sequence[Any]") -> None:
    """Raise ConfigError rather than leave unheard what somebody said of true poses, say."""
    from fusionslam.errors import ConfigError

    defaults = {"--stamps": "header"}
    for name, value in zip(_READING, how, strict=False):
        if value and value != defaults.get(name):
            raise ConfigError(f"{name}: {data} is {what}, which says all about itself")


def _truth(scenes: "SceneSet") -> str:
    return ", no true poses" if scenes.poses is None else ""


def _method(views: "ViewMatcherConfig") -> str:
    """What gave the ids, in a word or two."""
    from fusionslam.views.matcher import method_of

    method = method_of(views)
    objects = f"objects {views.preset}"
    first = {"alignment": method, "descriptor": views.descriptor}.get(method, objects)
    return first if views.second_stage is None else f"{first}, then {views.second_stage}"


def _written_report(judged: "ViewRun", output: Path, rule: str) -> Path:
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
