# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Options that several commands share, and the objects built from them."""

import functools
import inspect
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from fusionslam import help_texts

if TYPE_CHECKING:
    from logging import LogRecord

    from fusionslam.config import Section
    from fusionslam.pipelines.describe import PipelineConfig
    from fusionslam.pipelines.recording import Recording


Command = Callable[..., None]


def _start_logging(verbose: bool) -> bool:
    """Send the library's messages to stderr: warnings and above, or more if verbose."""
    import logging

    from rich.logging import RichHandler

    from fusionslam.cli.console import stderr

    handler = RichHandler(console=stderr(), show_path=False, show_time=False)
    level = logging.INFO if verbose else logging.WARNING
    handler.addFilter(_said_once())
    logging.basicConfig(level=level, format="%(message)s", handlers=[handler], force=True)
    return verbose


def _said_once() -> "Callable[[LogRecord], bool]":
    """Return a filter that passes each message once: data are reopened for each source."""
    said: set[str] = set()

    def is_new(entry: "LogRecord") -> bool:
        message = entry.getMessage()
        new = message not in said
        said.add(message)
        return new

    return is_new


Data = Annotated[
    Path,
    typer.Argument(
        metavar="DATA",
        help="A recording (folder, bag, .npz), a world (.glb, .world, .sdf), or town, warehouse, "
        "house, hospital; its kind is recognised.",
    ),
]
Results = Annotated[Path, typer.Argument(metavar="OUT", help="Folder with stored runs.")]
SkipBad = Annotated[
    bool,
    typer.Option(
        "--skip-bad-frames",
        help="Leave out frames that cannot be read or described; they are named.",
    ),
]
Truth = Annotated[
    Path | None,
    typer.Option("--gt", metavar="FILE", help="True poses (KITTI or TUM), not those of the data."),
]
Source = Annotated[
    str | None,
    typer.Option("--source", help=f"{help_texts.SOURCE}; else the first that the data allow."),
]
Sources = Annotated[
    str | None, typer.Option("--source", help=f"{help_texts.SOURCE}; else all that the data allow.")
]
Threshold = Annotated[float | None, typer.Option("--threshold", help=f"{help_texts.THRESHOLD}.")]
Radius = Annotated[float | None, typer.Option("--radius", help=f"{help_texts.RADIUS}.")]
Window = Annotated[int | None, typer.Option("--window", help=f"{help_texts.EVALUATION_WINDOW}.")]
Names = Annotated[
    str, typer.Option("--descriptors", "-d", help="m2dp, cm2dp, shot, cshot, with commas; or all.")
]
Settings = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="STAGE.KEY=VALUE", help="Change a value; may be repeated."),
]
ConfigFile = Annotated[
    Path | None, typer.Option("--config", metavar="FILE", help="YAML, as config --yaml prints.")
]
Jobs = Annotated[
    int | None, typer.Option("--jobs", "-j", min=1, help="Frames at a time; else one a core.")
]
Protocol = Annotated[str | None, typer.Option("--protocol", help=f"{help_texts.PROTOCOL}.")]
Verbose = Annotated[
    bool, typer.Option("--verbose", "-v", callback=_start_logging, help="Say more, on stderr.")
]


def cores(jobs: int | None) -> int:
    """Return the number of jobs asked for, else one per core that this process may use."""
    if jobs is not None:
        return jobs
    # macOS has no CPU affinity.
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def build_recording(
    data: Data,
    kind: Annotated[
        str | None,
        typer.Option(
            help="kitti-odometry, kitti-raw, kitti-object, folder, ranges, rosbag1, rosbag2, "
            "mcap or scenes."
        ),
    ] = None,
    sequence: Annotated[
        str | None, typer.Option(help="Which one, where DATA holds several.")
    ] = None,
    topic: Annotated[
        list[str] | None,
        typer.Option(
            metavar="WHAT=/NAME",
            help="Topic of a bag for points, left, camera_info, right, right_camera_info, odometry "
            "or truth; may be repeated.",
        ),
    ] = None,
    stamps: Annotated[
        str, typer.Option(help="Times of a bag's messages: header, or bag (their arrival).")
    ] = "header",
    sync: Annotated[
        list[str] | None,
        typer.Option(
            metavar="KEY=VALUE",
            help="How a bag's images go with its scans: policy=last_before, max_difference=0.05, "
            "...",
        ),
    ] = None,
    calib: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="calib.yaml, of a bag or folder without one."),
    ] = None,
    skip_gaps: Annotated[
        bool, typer.Option("--skip-gaps", help="Leave out frames of which a file is missing.")
    ] = False,
    gt: Truth = None,
) -> "Recording":
    """Build the recording that the options name."""
    from fusionslam.cli.worlds import record_if_world
    from fusionslam.datasets.bags.index import STAMPS
    from fusionslam.pipelines.recording import Recording

    one_of("--stamps", stamps, STAMPS)
    topics, changes = _topics(topic or []), _sync_changes(sync or [])
    path, simulated = record_if_world(data, cores(None))
    return Recording.at(
        path,
        kind=kind,
        sequence=sequence,
        gaps="skip" if skip_gaps else "error",
        poses=gt,
        topics=topics,
        stamps=stamps,
        sync=changes,
        calibration=calib,
        simulated=simulated,
    )


def reading_options(**fixed: Any) -> "Callable[[Command], Command]":
    """Give a command DATA and the options of ``build_recording``.

    They replace the command's parameter ``recording``, which receives the Recording. A command
    that declares one of them itself, such as ``data``, also receives its value.

    Args:
        fixed: values of options that this command does not offer.
    """

    def decorate(command: Command) -> Command:
        own = inspect.signature(command).parameters
        reading = {
            name: parameter
            for name, parameter in inspect.signature(build_recording).parameters.items()
            if name not in fixed
        }

        @functools.wraps(command)
        def run(**values: Any) -> None:
            how = {name: values[name] if name in own else values.pop(name) for name in reading}
            command(recording=build_recording(**fixed, **how), **values)

        added = [parameter for name, parameter in reading.items() if name not in own]
        place = list(own).index("recording")
        parameters = [*own.values()]
        parameters[place : place + 1] = added
        # Keyword-only, as parameters with a default may come before ones without.
        parameters = [each.replace(kind=each.KEYWORD_ONLY) for each in parameters]
        run.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
        run.__annotations__ = {each.name: each.annotation for each in parameters}
        return run

    return decorate


def _topics(texts: list[str]) -> dict[str, str]:
    """Parse texts such as points=/velodyne_points into a dictionary."""
    if not texts:
        return {}
    from fusionslam.datasets.bags.topics import ROLES

    _check_pairs("--topic", texts, "WHAT=/NAME")
    for text in texts:
        one_of(f"--topic {text}: WHAT", text.partition("=")[0], tuple(ROLES))
    return dict(text.split("=", 1) for text in texts)


def _sync_changes(texts: list[str]) -> dict[str, Any]:
    """Return the values of SyncConfig that differ from its defaults."""
    from fusionslam.config import with_settings
    from fusionslam.errors import ConfigError
    from fusionslam.sensors.synchronizer import SyncConfig

    _check_pairs("--sync", texts, "KEY=VALUE, such as policy=last_before")
    try:
        return with_settings(SyncConfig(), texts).model_dump(exclude_defaults=True)
    except ConfigError as error:
        raise ConfigError(f"--sync {', '.join(texts)}: {error}") from error


def _check_pairs(option: str, texts: list[str], expected: str) -> None:
    from fusionslam.errors import ConfigError

    for text in texts:
        if "=" not in text:
            raise ConfigError(f"{option} {text}: expected {expected}")


def everything() -> "Section":
    """Return the defaults of all stages and of the simulator."""
    from fusionslam.calibration.search import CalibrationCheckConfig
    from fusionslam.config import Section, option
    from fusionslam.datasets.range_recording import RecordingConfig
    from fusionslam.geometry.odometry_noise import DRIFT, OdometryConfig
    from fusionslam.pipelines.describe import PipelineConfig
    from fusionslam.pipelines.tuning import TuningConfig
    from fusionslam.ratslam.slam import RatSlamConfig
    from fusionslam.ratslam.visual_odometry import VisualOdometryConfig
    from fusionslam.sim import SimConfig
    from fusionslam.views.recognisers import ViewMatcherConfig
    from fusionslam.views.visual_templates import VisualTemplatesConfig

    class SystemConfig(PipelineConfig):
        """The whole configuration."""

        sim: SimConfig = option(SimConfig(), "the simulated drive of the demo")
        calib_check: CalibrationCheckConfig = option(
            CalibrationCheckConfig(), "what calib-check tries"
        )
        views: ViewMatcherConfig = option(ViewMatcherConfig(), "scenes to views")
        recording: RecordingConfig = option(
            RecordingConfig(), "how scans of a .npz recording become clouds"
        )
        tuning: TuningConfig = option(TuningConfig(), "how parameters of views are looked for")
        ratslam: RatSlamConfig = option(RatSlamConfig(), "views and odometry to a map")
        visual_templates: VisualTemplatesConfig = option(
            VisualTemplatesConfig(), "ratslam: views of images, --views visual_templates"
        )
        visual_odometry: VisualOdometryConfig = option(
            VisualOdometryConfig(), "ratslam: speed out of images, --odometry visual"
        )
        odometry: OdometryConfig = option(
            DRIFT, "ratslam: how far odometry is off, --odometry truth+noise"
        )

    whole: Section = SystemConfig()
    return whole


def pipeline_config(
    file: Path | None, settings: list[str] | None, **first: Any
) -> "PipelineConfig":
    """Return the defaults, changed by ``first``, then by the file, then by the settings.

    The file may have a section ``sim``, which only the demo reads.
    """
    from fusionslam.config import merged, with_file, with_settings
    from fusionslam.pipelines.describe import PipelineConfig

    config = merged(PipelineConfig(), first)
    if file is not None:
        whole = with_file(merged(everything(), first), file)
        stages = {name: getattr(whole, name) for name in PipelineConfig.model_fields}
        config = PipelineConfig(**stages)
    return with_settings(config, settings or [])


def warn_of_windows(config: "PipelineConfig") -> None:
    """Warn if loops are found with one window and evaluated with another."""
    import logging

    found, judged = config.loop_closure.window, config.evaluation.window
    if found != judged:
        logging.getLogger(__name__).warning(
            "loop_closure.window is %d and evaluation.window is %d: "
            "loops are found with one and judged with the other",
            found,
            judged,
        )


def bad_frames(skip: bool) -> str:
    """Return the value of ``bad_frames`` for the option to skip them."""
    return "skip" if skip else "error"


def source_of(chosen: str | None, config: "PipelineConfig", recording: "Recording") -> str:
    """Return the source given by option, else by configuration, else the first available."""
    from fusionslam.fusion import SOURCES

    if chosen is not None:
        one_of("--source", chosen, SOURCES)
        return chosen
    if "source" in config.fusion.model_fields_set:
        return config.fusion.source
    return recording.sources()[0]


def names_of(text: str) -> list[str]:
    """Return the named descriptors without repetition. Raises ConfigError for an unknown one."""
    from fusionslam.descriptors import DESCRIPTORS, descriptor_named

    names = list(DESCRIPTORS) if text == "all" else [name.strip() for name in text.split(",")]
    return list(dict.fromkeys(descriptor_named(name).name for name in names))


def one_of(key: str, value: str, values: tuple[str, ...]) -> None:
    """Raise ConfigError unless the value is one of these."""
    from fusionslam.config import explain_choice
    from fusionslam.errors import ConfigError

    if value not in values:
        raise ConfigError(f"{key} is {value!r}, {explain_choice(value, values)}")


def check_protocol(protocol: str | None) -> None:
    """Raise ConfigError for an unknown protocol; None is allowed."""
    from fusionslam.evaluation import PROTOCOLS

    if protocol is not None:
        one_of("--protocol", protocol, tuple(PROTOCOLS))


def command_line() -> str:
    """Return the command line, quoted so that it can be run again."""
    import shlex

    return shlex.join(["fusionslam", *sys.argv[1:]])
