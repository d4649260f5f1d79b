# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The program around the commands: version, help, completion, names of choices."""

import ast
import re
import sys
from importlib import import_module
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from typing import get_args, get_type_hints

import pytest
from typer.main import get_command
from typer.testing import CliRunner

import fusionslam
from cli import error_of, fails, run, succeeds
from expected_output import commands_of
from fusionslam.base.texts import counted
from fusionslam.cli import app
from fusionslam.cli import options as opt
from fusionslam.cli.console import progress_lines
from rows import rows
from scenes import LAPS, drive, write_recording


def test_the_version_is_that_of_the_package() -> None:
    assert succeeds("--version").stdout == f"fusionslam {version('fusionslam')}\n"


@rows("words", [(), ("describe",), ("bench", "views"), ("views", "match")])
def test_help_has_three_spellings(words: tuple[str, ...]) -> None:
    text = succeeds(*words, "--help").stdout
    assert " ".join(("fusionslam", *words)) in text.replace("root", "fusionslam")
    assert succeeds(*words, "-h").stdout == text
    said = succeeds("help", *words).stdout
    assert said.splitlines()[1:] == text.splitlines()[1:]


def test_help_of_an_unknown_command_is_a_mistake() -> None:
    assert "'descibe'" in fails(2, "help", "descibe")


def complete(shell: str, line: str) -> list[str]:
    """What a shell is offered for the last word of a line."""
    words = line.split(" ")
    asked = {
        "_FUSIONSLAM_COMPLETE": f"complete_{shell}",
        "COMP_WORDS": line,
        "COMP_CWORD": str(len(words) - 1),
        "_TYPER_COMPLETE_ARGS": line,
        "_TYPER_COMPLETE_FISH_ACTION": "get-args",
    }
    result = CliRunner().invoke(app, [], env=asked, prog_name="fusionslam")
    assert result.exit_code == 0 and result.stderr == ""
    return result.stdout.replace('"', " ").split()


@rows(
    "line, offered",
    [
        ("fusionslam des", "describe"),
        ("fusionslam ratslam --odom", "--odometry"),
        ("fusionslam ratslam --odometry vi", "visual"),
        ("fusionslam bench views --frame dr", "drift"),
        ("fusionslam describe -d m2dp,cs", "m2dp,cshot"),
        ("fusionslam sim wa", "warehouse"),
        ("fusionslam config loop", "loop_closure"),
        ("fusionslam ros run data", "data_fusion"),
        ("fusionslam ros launch ba", "bag"),
    ],
)
def test_shells_complete_commands_options_and_choices(line: str, offered: str) -> None:
    for shell in ("bash", "zsh", "fish"):
        assert offered in complete(shell, line), shell


def test_without_a_terminal_steps_begin_with_a_line_and_long_ones_repeat_it() -> None:
    lines: list[str] = []
    times = iter([0.0, 0.0, 5.0, 11.0, 12.0, 13.0, 22.5])
    show = progress_lines(lines.append, lambda: next(times))
    for done in (0, 10, 20, 25):  # at 0, 5, 11, 12 s
        show("describing", done, 100)
    show("writing the report", 0, 1)
    show("writing the report", 1, 1)
    assert lines[:3] == [
        "describing: 0 of 100",
        "describing: 20 of 100, about 44 s left",
        "writing the report",
    ]


def test_choices_are_those_of_the_registries() -> None:
    from fusionslam import evaluation, fusion
    from fusionslam.datasets.bags.indexed_bag import STAMPS
    from fusionslam.datasets.kinds import KINDS
    from fusionslam.datasets.range_recording import SHAPES
    from fusionslam.pipelines import compare_descriptors
    from fusionslam.pipelines.drives import FRAMES
    from fusionslam.pipelines.export_folder import FORMATS
    from fusionslam.pipelines.map_events import ODOMETRY
    from fusionslam.ratslam.slam import RatSlamConfig
    from fusionslam.sim.catalogue import MADE
    from fusionslam.views.presets import preset_names
    from fusionslam.views.recognisers import RECOGNISERS

    preset = get_type_hints(RatSlamConfig)["preset"]
    presets = next(names for each in get_args(preset) if (names := get_args(each)))
    for offered, known in (
        (opt.FORMATS, FORMATS),
        (opt.FRAMES, FRAMES),
        (opt.KINDS, (*KINDS, "scenes")),
        (opt.ODOMETRY, ODOMETRY),
        (opt.PRESETS_OF_RATSLAM, presets),
        (opt.PROTOCOLS, evaluation.PROTOCOLS),
        (opt.VERIFY, compare_descriptors.VERIFY),
        (opt.RECOGNISERS, RECOGNISERS),
        (opt.RULES, evaluation.VIEW_RULES),
        (opt.SHAPES, SHAPES),
        (opt.SOURCES, fusion.SOURCES),
        (opt.STAMPS, STAMPS),
        (opt.TUNED, preset_names()),
        (opt.WORLDS, MADE),
    ):
        assert sorted(offered) == sorted(known)
    for words in (("demo", "--world", "mars", "-o", "x"), ("report", ".", "--protocol", "revist")):
        assert error_of(2, *words).code == "choice"


@pytest.fixture
def without_report(monkeypatch: pytest.MonkeyPatch) -> None:
    """Hide the packages of the extra report."""
    hidden = ("matplotlib", "jinja2")
    for name in (*hidden, *(each for each in sys.modules if each.split(".")[0] in hidden)):
        monkeypatch.setitem(sys.modules, name, None)
    for module in ("fusionslam.cli.failures", "fusionslam.report.page.html"):
        monkeypatch.setattr(
            f"{module}.find_spec", lambda name: None if name in hidden else find_spec(name)
        )


@pytest.mark.slow
@rows(
    "words, option, file",
    [
        (("bench", "KITTI", "-d", "m2dp", "--verify", "none"), ("--no-report",), "metrics.json"),
        (("views", "match", "SCENES"), ("--no-report",), "matches.csv"),
        (("ratslam", "RANGES", "--views", "m2dp"), ("--no-report",), "map.json"),
        (("bench", "views", "SCENES", "-m", "objects"), ("--no-report",), "views.md"),
        (("calib-check", "KITTI"), ("--pictures", "0"), "calib_check.json"),
    ],
)
def test_without_the_extra_report_a_command_names_the_option_that_does_without_it(
    words: tuple[str, ...],
    option: tuple[str, ...],
    file: str,
    kitti: Path,
    tmp_path: Path,
    without_report: None,
) -> None:
    data = {"KITTI": kitti, "SCENES": tmp_path / "s.npz", "RANGES": tmp_path / "r.npz"}
    drive(LAPS).save(data["SCENES"])
    write_recording(data["RANGES"], LAPS)
    command = [data.get(word, word) for word in words]
    error = error_of(1, *command, "-o", tmp_path / "out")
    assert (error.code, error.fields) == ("missing-extra", ("report",))
    assert " ".join(option) in str(error) and not list((tmp_path / "out").glob("*.*"))
    result = run(*command, "-o", tmp_path / "out", *option)
    if "calib-check" not in words:  # whose data have no edges here
        assert result.exit_code == 0, result.output
        assert (tmp_path / "out" / file).exists()
    assert "matplotlib" not in result.stderr and "jinja2" not in result.stderr


@rows(
    "name",
    ["benchmarks.accuracy.bag_depth", "benchmarks.ros.__main__", "benchmarks.speed.simulation"],
)
def test_benchmarks_help_instead_of_computing(
    name: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", [name, "--help"])
    with pytest.raises(SystemExit) as ended:
        import_module(name).main()
    assert ended.value.code == 0 and "usage: " in capsys.readouterr().out


@rows(
    "count, noun, text",
    [(1, "frame", "1 frame"), (0, "frame", "0 frames"), (1200, "query", "1,200 queries")],
)
def test_counts_agree_with_their_nouns(count: int, noun: str, text: str) -> None:
    assert counted(count, noun, ",") == text


def options_of_commands() -> dict[str, set[str]]:
    """The options of each command, by its name."""
    return {
        name: {option for each in command.params for option in each.opts} | {"--help"}
        for name, command in commands_of(get_command(app)).items()
    }


FOREIGN = {
    **dict.fromkeys(("--clock", "--delay", "--quiet", "--rate", "--topics"), "rosbag play"),
    "--wait-for-subscribers": "rosbag play",
    "--head": "ray start",
    "--force-reinstall": "pip",
    "--no-install-recommends": "apt-get",
    **dict.fromkeys(("--ros-args", "--remap"), "ros2 run"),
    **dict.fromkeys(
        ("--yaw", "--pitch", "--roll", "--frame-id", "--child-frame-id"),
        "static_transform_publisher",
    ),
}
"""Options of other programs that messages name."""


@pytest.mark.slow
def test_every_option_that_a_message_names_exists_in_the_command() -> None:
    commands = options_of_commands()
    every = set.union(*commands.values())
    named = "|".join(sorted(filter(None, commands), key=len, reverse=True))
    with_command = re.compile(rf"\b({named}) (--[a-z][a-z-]+)")
    folder = Path(fusionslam.__file__).parent
    for path in sorted(folder.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text())):
            if not (isinstance(node, ast.Constant) and isinstance(node.value, str)):
                continue
            for option in re.findall(r"(?<![\w-])--[a-z][a-z-]+", node.value):
                assert option in every or option in FOREIGN, f"{path}:{node.lineno}: {option}"
            for command, option in with_command.findall(node.value):
                assert option in commands[command], f"{path}:{node.lineno}: {command} {option}"


def test_what_info_advises_is_taken_by_every_command_that_reads_data() -> None:
    readers = {name: found for name, found in options_of_commands().items() if "--topic" in found}
    del readers["ros2 play"]  # plays messages as they are
    assert len(readers) > 10
    for name, options in readers.items():
        assert {"--sequence", "--calib", "--stamps", "--sync"} <= options, name
        assert ("--skip-gaps" in options) == (name != "info"), name
