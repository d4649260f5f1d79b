# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The commands info, config and doctor: what a recording, the configuration, this machine has."""

from collections.abc import Callable, Collection
from functools import partial
from typing import TYPE_CHECKING, Annotated, Any

import typer

from fusionslam.base.progress import label_progress
from fusionslam.cli import options as opt
from fusionslam.cli.console import print_findings, print_table, progress
from fusionslam.cli.failures import DATA, missing_extras
from fusionslam.cli.recordings import build_recording

if TYPE_CHECKING:
    from fusionslam.config import Section
    from fusionslam.pipelines.recording import Recording


@opt.command
def info(
    build_recording: Annotated[Callable[[], "Recording"], partial(build_recording, skip_gaps=True)],
    every: Annotated[
        bool, typer.Option("--all", help="Read all frames, and name those that cannot be read.")
    ] = False,
    jobs: opt.Jobs = None,
) -> None:
    """Summarise DATA: frames, sensors, calibration, poses, gaps; say what stored results are."""
    from fusionslam.pipelines.frame_check import check_frames
    from fusionslam.pipelines.overview import look_at

    recording = build_recording()
    with progress() as step:
        show = label_progress(step, "reading")
        check = partial(check_frames, jobs=opt.cores(jobs), progress=show) if every else None
        found = look_at(recording, check)
    print_table(["what", "value"], found.rows)


def config(
    stage: Annotated[
        str | None,
        typer.Argument(
            metavar="[STAGE]",
            autocompletion=opt.completed_from(lambda: type(opt.read_config()).model_fields),
            help="Print only this stage.",
        ),
    ] = None,
    yaml: Annotated[bool, typer.Option("--yaml", help="Print YAML that --config reads.")] = False,
    settings: opt.Settings = None,
    file: opt.ConfigFile = None,
) -> None:
    """Print every value of the configuration with its unit, range and help."""
    from fusionslam.config import as_yaml

    whole = opt.read_config(settings, file)
    opt.check_choice("stage", stage, tuple(type(whole).model_fields))
    stages = [stage] if stage else list(type(whole).model_fields)
    if yaml:
        print(as_yaml(whole, stages), end="")
        return
    print_table(["key", "value", "unit", "range", "help"], list_values(whole, stages))


def list_values(whole: "Section", stages: Collection[str]) -> list[list[str]]:
    """Return key, value, unit, range and help of every value of the given stages."""
    from fusionslam.config import range_of, unit_of, walk

    return [
        [
            key,
            _value(value),
            unit_of(definition),
            range_of(definition),
            definition.description or "",
        ]
        for key, value, definition in walk(whole)
        if key.partition(".")[0] in stages
    ]


def _value(value: Any) -> str:
    if value is None:
        return "none"
    return str(value).lower() if isinstance(value, bool) else str(value)


def doctor() -> None:
    """Check what works on this machine, and say what to install."""
    from fusionslam.doctor import examine
    from fusionslam.ros.ros1.environment import check_ros
    from fusionslam.ros.ros2.environment import check_ros2

    findings = [*examine(missing_extras()), check_ros(), check_ros2()]
    print_findings(findings, "missing")
    if not all(finding.fine or finding.optional for finding in findings):
        raise typer.Exit(DATA)
