# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The program as a process: entry points, exit codes, signals, pipes and other programs."""

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

import fusionslam
from cli import settings, succeeds
from fusionslam.evaluation.maps.run import RatSlamRun
from fusionslam.ratslam import RatSlam
from fusionslam.sensors.messages import Scan
from project import SUPPORT
from recordings import write_drive
from rows import rows

PACKAGES = Path(fusionslam.__file__).parents[1]
ENVIRONMENT = os.environ | {"PYTHONPATH": f"{PACKAGES}{os.pathsep}{SUPPORT}"}
PROGRAM = "from fusionslam.__main__ import main\nmain()\n"
SMALL_WORLD = """
from fusionslam.sim import catalogue
from worlds import hall
entry = catalogue.MADE["warehouse"]
hall_of = lambda settings: hall()
catalogue.MADE["warehouse"] = catalogue.Entry(entry.settings, hall_of, entry.robot)
"""
INTERRUPTED = """
import os
whole, calls = {owner}.{method}, []
def counted(self, *more):
    calls.append(more)
    if len(calls) == {count}:
        os.kill(os.getpid(), {number})
    return whole(self, *more)
{owner}.{method} = counted
"""
"""The process sends itself a signal, as a key does, but at a known step."""


@contextmanager
def started(code: str, *words: object, **more: Any) -> Iterator["subprocess.Popen[str]"]:
    command = [sys.executable, "-c", code, *map(str, words)]
    options: dict[str, Any] = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE} | more
    with subprocess.Popen(command, env=ENVIRONMENT, text=True, **options) as process:
        yield process


def ended(code: str, *words: object, **more: Any) -> tuple[int, str, str]:
    """Exit status, output and messages of a process."""
    with started(code, *words, **more) as process:
        output, messages = process.communicate()
    return process.returncode, output, messages


def test_the_module_runs_as_the_program_does() -> None:
    words = [sys.executable, "-m", "fusionslam", "--version"]
    result = subprocess.run(words, env=ENVIRONMENT, capture_output=True, text=True, check=True)
    assert result.stdout == succeeds("--version").stdout


@pytest.mark.parametrize(
    "shell", ["bash", *(pytest.param(name, marks=pytest.mark.nightly) for name in ("zsh", "fish"))]
)
def test_the_completion_of_a_shell_can_be_shown_and_installed(
    shell: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # So that typer takes the name of the shell as a value, for shells that are not installed.
    monkeypatch.setitem(ENVIRONMENT, "_TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION", "1")
    monkeypatch.setitem(ENVIRONMENT, "HOME", str(tmp_path))
    assert f"_FUSIONSLAM_COMPLETE=complete_{shell}" in ended(PROGRAM, "--show-completion", shell)[1]
    assert ended(PROGRAM, "--install-completion", shell)[0] == 0
    assert any("fusionslam" in path.name for path in tmp_path.rglob("*") if path.is_file())


@rows(
    "words, expected, heavy",
    [(["--help"], "describe", ["numpy", "pydantic"]), (["bench", "--help"], "--jobs", ["numpy"])],
)
def test_help_loads_nothing_heavy(words: list[str], expected: str, heavy: list[str]) -> None:
    code = (
        "import sys\nfrom fusionslam.cli import app\n"
        f"app({words!r}, standalone_mode=False)\n"
        f"sys.exit(', '.join({{*{heavy}, 'yaml', 'PIL', 'fusionslam._core'}} & set(sys.modules)))"
    )
    _, output, messages = ended(code)
    assert expected in output and messages.strip() == ""


@pytest.mark.parametrize(
    "words",
    [
        ("config",),
        pytest.param(("eval", "OUT"), marks=pytest.mark.nightly),
        pytest.param(("describe", "KITTI", "-d", "m2dp", "-o", "OUT"), marks=pytest.mark.nightly),
    ],
    ids=lambda words: words[0],
)
def test_a_reader_who_has_enough_is_no_error(
    words: tuple[str, ...], kitti: Path, tmp_path: Path
) -> None:
    if "OUT" in words:
        succeeds("describe", kitti, "-d", "m2dp", "-o", tmp_path)
    names = {"KITTI": kitti, "OUT": tmp_path}
    reading, writing = os.pipe()
    os.close(reading)
    with started(PROGRAM, *(names.get(word, word) for word in words), stdout=writing) as process:
        os.close(writing)
        messages = process.communicate()[1]
    assert "error" not in messages.lower() and process.returncode == 0


def test_an_interruption_while_the_program_loads_is_quiet(tmp_path: Path) -> None:
    package = tmp_path / "typer"  # is loaded first, and here takes its time
    package.mkdir()
    (package / "__init__.py").write_text(
        "import signal\nprint('loading', flush=True)\nwhile True:\n    signal.pause()\n"
    )
    with started(f"import sys\nsys.path.insert(0, {str(tmp_path)!r})\n{PROGRAM}") as process:
        assert process.stdout is not None and process.stdout.readline() == "loading\n"
        process.send_signal(signal.SIGINT)
        assert process.communicate()[1] == ""
    assert process.returncode == 130


@pytest.mark.slow
def test_a_real_ctrl_c_keeps_the_map_that_there_is(tmp_path: Path) -> None:
    code = "from fusionslam.pipelines.maps import RunRecorder\n" + INTERRUPTED.format(
        owner="RunRecorder", method="_keep", count=300, number=int(signal.SIGINT)
    )
    data, out = write_drive(tmp_path / "drive.npz"), tmp_path / "out"
    words = ("ratslam", data, "--views", "objects", "-o", out, "--no-report", "--jobs", "1")
    status, _, messages = ended(code + PROGRAM, *words)
    assert status == 130, messages
    assert "--resume" in messages and "Traceback" not in messages
    assert len(RatSlamRun.load(out / "run.npz")) == 300
    assert RatSlam.load(out / "state.npz").seen_ns[0] is not None


@pytest.mark.parametrize(
    "number", [signal.SIGINT, pytest.param(signal.SIGTERM, marks=pytest.mark.nightly)]
)
def test_a_stopped_recording_keeps_what_is_whole(tmp_path: Path, number: signal.Signals) -> None:
    pytest.importorskip("embreex", reason="the simulator is an extra")
    bags = pytest.importorskip("fusionslam.datasets.bags")
    pytest.importorskip("rosbags", reason="bags are an extra")
    code = "from fusionslam.datasets.bags.writer import BagWriter\n" + INTERRUPTED.format(
        owner="BagWriter", method="write", count=40, number=int(number)
    )
    small = ("robot.cameras.camera.width=64", "robot.cameras.camera.height=48")
    words = settings("plan.length_m=8", "plan.spacing_m=2", *small)
    out = tmp_path / "out.bag"
    status, _, messages = ended(
        SMALL_WORLD + code + PROGRAM, "sim", "warehouse", "-o", out, "--jobs", "1", *words
    )
    assert status == 130, messages
    assert "out.bag is not complete" in messages
    assert [path.name for path in tmp_path.iterdir()] == ["out.partial.bag"]
    with bags.open_bag(tmp_path / "out.partial.bag") as bag:
        assert any(isinstance(event.message, Scan) for event in bag.events())


def test_what_follows_a_launch_file_goes_to_roslaunch_as_it_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    program = tmp_path / "roslaunch"
    program.write_text('#!/bin/sh\nprintf "%s\\n" "$PWD" "$@"\n')
    program.chmod(0o755)
    monkeypatch.setitem(ENVIRONMENT, "PATH", f"{tmp_path}:{os.environ['PATH']}")
    (tmp_path / "own.launch").write_text("<launch/>")
    passed = ["own.launch", "scan:=/points", "-p", "11312", "--screen"]
    code = "from fusionslam.ros.ros1 import environment\nenvironment.need_ros = lambda: None\n"
    status, output, messages = ended(code + PROGRAM, "ros", "launch", *passed, cwd=tmp_path)
    assert status == 0, messages
    assert output.splitlines() == [str(tmp_path), *passed]
