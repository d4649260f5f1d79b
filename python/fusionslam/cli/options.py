# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Options that several commands share, and the objects built from them."""

import functools
import inspect
import sys
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, get_origin

import typer

from fusionslam import descriptors
from fusionslam.base import texts
from fusionslam.base.parallel import available_cores

if TYPE_CHECKING:
    from fusionslam.pipelines.describe import PipelineConfig
    from fusionslam.pipelines.recording import Recording


Command = Callable[..., None]


def _start_logging(ctx: typer.Context, verbose: bool) -> bool:
    from fusionslam.cli.logs import start_logging

    start_logging(ctx, verbose=verbose)
    return verbose


FORMATS = ("ply", "pcd", "bin")
FRAMES = ("robot", "odometry", "drift")
KINDS = (
    *("kitti-object", "kitti-odometry", "kitti-360", "kitti-raw", "mulran", "nclt"),
    *("folder", "ranges"),
    *("rosbag1", "rosbag2", "mcap", "scenes"),
)
ODOMETRY = ("topic", "lidar", "inertial", "visual", "truth", "truth+noise")
POSE_FORMATS = ("tum", "kitti")
PRESETS_OF_RATSLAM = ("robust", "openratslam")
PROTOCOLS = (
    *("revisit", "perdomo2019", "pose-1m-5deg", "pose-2m-5deg"),
    *("ssc", "scancontext", "solid"),
)
RECOGNISERS = (
    *("alignment", "objects", "two_stages", *descriptors.NAMES),
    "visual_templates",
)
RULES = ("paper", "author", "car")
SHAPES = ("visual", "collision")
SOURCES = ("lidar", "stereo", "cloud")
STAMPS = ("header", "bag")
VERIFY = ("each", "one", "none")
TUNED = ("warehouse_paper", "warehouse_robust")
WORLDS = ("town", "warehouse", "house", "hospital")
# Copies of the registries, which take too long to import for --help; a test compares them.


def one_of(*flags: str, names: Sequence[str], help: str, check: bool = True) -> Any:
    """Return an option that takes one of some names; help and completion list them.

    Args:
        flags: of the option, the long one first.
        names: valid values.
        help: of the option.
        check: whether to refuse other values; the command does otherwise.
    """
    return typer.Option(
        *flags,
        metavar=f"[{'|'.join(names)}]",
        autocompletion=completed_from(lambda: names),
        callback=(lambda value: check_choice(flags[0], value, names)) if check else None,
        help=help,
    )


def completed_from(names: Callable[[], Iterable[str]]) -> Callable[[str], list[str]]:
    """Return the completion of a value that is one of some names, which may take time to load."""
    return lambda incomplete: [name for name in names() if name.startswith(incomplete)]


def some_of(*flags: str, names: Sequence[str], help: str) -> Any:
    """As ``one_of``, for names with commas, which the command checks."""

    def complete(incomplete: str) -> list[str]:
        before, comma, last = incomplete.rpartition(",")
        return [before + comma + name for name in names if name.startswith(last)]

    shown = f"[{'|'.join(names)}],..."
    return typer.Option(*flags, metavar=shown, autocompletion=complete, help=help)


Results = Annotated[Path, typer.Argument(metavar="OUT", help="Folder with stored runs.")]
SkipBad = Annotated[
    bool,
    typer.Option(
        "--skip-bad-frames",
        help="Leave out and name frames that cannot be read or described.",
    ),
]
Truth = Annotated[
    Path | None,
    typer.Option(
        "--gt", metavar="FILE", help="True poses (KITTI or TUM) in place of those of the data."
    ),
]
Source = Annotated[
    str | None,
    one_of(
        "--source",
        names=SOURCES,
        help=f"{texts.SOURCE}; by default the first that the data allow.",
    ),
]
Sources = Annotated[
    str | None,
    one_of(
        "--source",
        names=SOURCES,
        help=f"{texts.SOURCE}; by default all that the data allow.",
    ),
]
Threshold = Annotated[
    str | None,
    typer.Option(
        "--threshold",
        metavar="DISTANCE|FOLDER",
        help=f"{texts.THRESHOLD}; or a folder of bench, for the distance up to which 95 % of "
        "its loops are right.",
    ),
]
Radius = Annotated[float | None, typer.Option("--radius", help=f"{texts.RADIUS}.")]
Window = Annotated[int | None, typer.Option("--window", help=f"{texts.EVALUATION_WINDOW}.")]
Names = Annotated[
    str,
    some_of(
        "--descriptors",
        "-d",
        names=(*descriptors.NAMES, *descriptors.GROUPS),
        help="Names of descriptors, with commas, each with a preset if wanted (cm2dp:author), or "
        "module:function of one of your own; "
        f"usual: {', '.join(descriptors.USUAL)}; or all.",
    ),
]
Settings = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="STAGE.KEY=VALUE", help="Change a value; may be repeated."),
]
ConfigFile = Annotated[
    Path | None,
    typer.Option("--config", metavar="FILE", help="YAML file, as config --yaml prints."),
]
Jobs = Annotated[
    int | None,
    typer.Option("--jobs", "-j", min=1, help="Frames in parallel; by default one per core."),
]
Protocol = Annotated[
    str | None,
    one_of("--protocol", names=PROTOCOLS, help=f"{texts.PROTOCOL}."),
]
SceneSets = Annotated[
    list[Path], typer.Argument(metavar="SCENES...", help="Scene sets or .npz recordings.")
]
Verify = Annotated[
    str,
    one_of(
        "--verify",
        names=VERIFY,
        help="Whose loops are proven: those that each descriptor alone proposes, by the same "
        "verifier, those of one descriptor with its voters, or none. It takes most of the time.",
    ),
]
Seeds = Annotated[
    str | None,
    typer.Option(
        "--seeds",
        metavar="SEED,...",
        help="Make the world that DATA names with each of these seeds; mean and range of all.",
    ),
]
Tuned = Annotated[
    str | None,
    one_of("--tuned", names=TUNED, check=False, help="Tuned values that come with fusionslam."),
]
MapFile = Annotated[Path, typer.Argument(metavar="MAP", help="A map's file (.fsmap).")]
Rule = Annotated[
    str,
    one_of(
        "--rule",
        names=RULES,
        help="How views are judged: by limits for a robot (paper, author) or a car.",
    ),
]
# By default out/COMMAND; commands that write a single file demand its name.
Folder = Annotated[Path, typer.Option("--output", "-o", help="Folder for what is written.")]
NoReport = Annotated[bool, typer.Option("--no-report", help="Write no page, which takes a while.")]
Verbose = Annotated[
    bool,
    typer.Option("--verbose", "-v", callback=_start_logging, help="Show more messages, on stderr."),
]


def bad_frames(skip: bool) -> str:
    """Return the pipelines' name for what --skip-bad-frames chooses."""
    return "skip" if skip else "error"


def command(function: Command) -> Command:
    """Give a command the options of functions that it takes, and --verbose.

    A parameter of the type Annotated[Callable[...], function] stands for the options that this
    function declares: they are listed in its place. The command receives the function with the
    options filled in, and calls it with the other arguments, after the checks that should come
    first. Options that ``functools.partial`` fixes are not offered.
    """
    own = inspect.signature(function).parameters
    functions = {name: found for name, each in own.items() if (found := _function_of(each))}
    options = {name: _options(each) for name, each in functions.items()}
    added: dict[str, inspect.Parameter] = {}
    for name, parameter in own.items():
        added |= options.get(name, {name: parameter})
    added["verbose"] = _VERBOSE
    # Keyword-only, as parameters with a default may come before ones without.
    parameters = [each.replace(kind=each.KEYWORD_ONLY) for each in added.values()]

    @functools.wraps(function)
    def run(**values: Any) -> None:
        given: dict[str, Any] = {name: values[name] for name in own if name in values}
        for name, each in functions.items():
            filled = {option: values[option] for option in options[name]}
            given[name] = functools.partial(each, **filled)
        function(**given)

    run.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    run.__annotations__ = {each.name: each.annotation for each in parameters}
    return run


def _function_of(parameter: inspect.Parameter) -> Callable[..., Any] | None:
    """Return the function whose options a parameter stands for; None for an option itself."""
    if get_origin(parameter.annotation) is not Annotated:
        return None
    meant = parameter.annotation.__metadata__[0]
    return meant if callable(meant) else None


def _options(function: Callable[..., Any]) -> dict[str, inspect.Parameter]:
    """Return the parameters that declare an option, by name."""
    fixed = filled(function)
    return {
        name: parameter
        for name, parameter in inspect.signature(function).parameters.items()
        if get_origin(parameter.annotation) is Annotated and name not in fixed
    }


_VERBOSE = inspect.Parameter(
    "verbose", inspect.Parameter.KEYWORD_ONLY, default=False, annotation=Verbose
)


def cores(jobs: int | None) -> int:
    """Return the number of jobs asked for, else one per core that this process may use."""
    return available_cores() if jobs is None else jobs


def read_config(settings: Settings = None, config: ConfigFile = None, **first: Any) -> Any:
    """Return the configuration of all stages.

    It is the defaults, changed by ``first``, then by the file, then by the settings.
    """
    from fusionslam.cli.system_config import SystemConfig
    from fusionslam.config import merged, with_file, with_settings

    whole = merged(SystemConfig(), first)
    if config is not None:
        whole = with_file(whole, config)
    return with_settings(whole, settings or [])


def pipeline_config(
    settings: Settings = None, config: ConfigFile = None, **first: Any
) -> "PipelineConfig":
    """As ``read_config``, for descriptors: settings of other stages are refused."""
    from fusionslam.config import merged, with_settings
    from fusionslam.pipelines.describe import PipelineConfig

    stages = merged(PipelineConfig(), first)
    if config is not None:
        whole = read_config(None, config, **first)
        stages = PipelineConfig(
            **{name: getattr(whole, name) for name in type(stages).model_fields}
        )
    return with_settings(stages, settings or [])


def views_config(
    source: Source = None,
    tuned: Tuned = None,
    settings: Settings = None,
    config: ConfigFile = None,
    **first: Any,
) -> Any:
    """As ``read_config``, with clouds in the robot's frame without ground, and tuned values."""
    from fusionslam.config import merged
    from fusionslam.fusion import ROBOT_FUSION
    from fusionslam.views.presets import load_preset

    first["fusion"] = ROBOT_FUSION.model_dump(exclude_unset=True)
    if tuned is not None:
        first["views"] = load_preset(tuned).model_dump(exclude_unset=True)
    whole = read_config(settings, config, **first)
    return whole if source is None else merged(whole, {"fusion": {"source": source}})


ReadConfig = Annotated[Callable[..., Any], read_config]
"""For a command: the configuration, with the options that change it."""
PipelineConfigOf = Annotated[Callable[..., "PipelineConfig"], pipeline_config]
ViewsConfigOf = Annotated[Callable[..., Any], views_config]


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


def choose_source(chosen: str | None, config: "PipelineConfig", recording: "Recording") -> str:
    """Return the source given by option, else by configuration, else the first available."""
    if chosen is None and "source" in config.fusion.model_fields_set:
        return config.fusion.source
    return chosen or recording.sources()[0]


def parse_names(text: str, default_preset: str = "robust") -> list[str]:
    """Return the named descriptors without repetition: "cm2dp", "cm2dp:author".

    Args:
        text: of the option.
        default_preset: the configured one, which need not be named.

    Raises:
        ConfigError: an unknown descriptor or preset.
    """
    from fusionslam.descriptors import load_descriptor

    names = descriptors.GROUPS.get(text) or [name.strip() for name in text.split(",")]
    for name in names:
        load_descriptor(name)
    return list(dict.fromkeys(name.removesuffix(f":{default_preset}") for name in names))


def parse_seeds(text: str) -> tuple[int, ...]:
    """Return the numbers in a text such as "1,2,3", without repetition. Raises ConfigError."""
    from fusionslam.errors import ConfigError

    words = [word.strip() for word in text.split(",")]
    if not all(word.isascii() and word.isdigit() for word in words):
        raise ConfigError(
            f"--seeds {text}: expected whole numbers with commas, such as 1,2,3",
            code="choice",
            fields=("--seeds", text),
        )
    return tuple(dict.fromkeys(map(int, words)))


def check_choice(key: str, value: str | None, values: Sequence[str]) -> str | None:
    """Return the value. Raises ConfigError unless it is one of these or None."""
    if value is not None and value not in values:
        from fusionslam.config import explain_choice
        from fusionslam.errors import ConfigError

        problem = explain_choice(value, values)
        raise ConfigError(f"{key} is {value!r}, {problem}", code="choice", fields=(key, value))
    return value


def check_folder_name(output: Path, suffixes: Sequence[str], instead: str) -> None:
    """Check that the name of a folder does not look like a file of a kind that is not written.

    Args:
        output: the folder.
        suffixes: those that are written as files.
        instead: the option that writes a folder of any name.

    Raises:
        ConfigError: the name has a suffix with a letter in it.
    """
    from fusionslam.errors import ConfigError

    if any(letter.isalpha() for letter in output.suffix):
        raise ConfigError(
            f"--output {output}: {output.suffix} is no kind of recording that is written; expected "
            f"{', '.join(suffixes)}, or a folder: {instead} writes one of this name",
            code="suffix",
            fields=(output.suffix, *suffixes),
        )


def check_output(output: Path, *sources: "Path | Callable[..., Any] | None") -> None:
    """Check that a file can be written: it is no recording, no map, and nothing that is read.

    Args:
        output: the file.
        sources: files and folders that are read, or functions of a ``command`` whose options name
            them.

    Raises:
        DataError: as ``fusionslam.pipelines.results.check_output``.
    """
    from fusionslam.pipelines.results import check_output

    inputs: list[Path] = []
    for source in sources:
        named = [source] if isinstance(source, Path) else filled(source).values()
        inputs += [value for value in named if isinstance(value, Path)]
    check_output(output, inputs)


def filled(function: "Callable[..., Any] | None") -> dict[str, Any]:
    """Return the arguments that ``functools.partial`` fixed."""
    return getattr(function, "keywords", {})


def command_line() -> str:
    """Return the command line, quoted so that it can be run again."""
    import shlex

    return shlex.join(["fusionslam", *sys.argv[1:]])
