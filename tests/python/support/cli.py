# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Running the command line in tests."""

import csv
import itertools
from collections.abc import Callable
from pathlib import Path
from typing import Any

from typer import Typer
from typer.testing import CliRunner, Result

from fusionslam.cli import app
from fusionslam.descriptors import USUAL
from fusionslam.errors import FusionSlamError
from fusionslam.evaluation import DescriptorRun
from fusionslam.pipelines.describe import CHUNK

FRAMES = CHUNK + 4
NO_WINDOW = ("--set", "evaluation.window=2", "--set", "loop_closure.window=2")
TINY_TOWN = (
    "sim.town.blocks=[1,1]",
    "sim.town.block_m=44",
    "sim.drive.laps=[[[0,0],[1,0]],[[1,0],[1,1]]]",
    "sim.drive.spacing_m=14",
    "sim.car.lidar.rings=16",
    "sim.car.lidar.azimuths=180",
    "sim.car.camera.width=160",
    "sim.car.camera.height=48",
    "sim.car.camera.focal_px=92",
    "sim.car.camera.centre_px=[79,23.5]",
)


def settings(*texts: str) -> list[str]:
    """Each of these after its own ``--set``."""
    return [word for text in texts for word in ("--set", text)]


def interrupted_at(call: int, work: Callable[..., Any] = lambda *_, **__: None) -> Any:
    """A function, with Ctrl-C in place of one of its calls, of which the first is number 0."""
    calls = itertools.count()

    def counted(*arguments: Any, **named: Any) -> Any:
        if next(calls) == call:
            raise KeyboardInterrupt
        return work(*arguments, **named)

    return counted


def run(*arguments: object, command: Typer = app) -> Result:
    return CliRunner().invoke(command, [str(argument) for argument in arguments])


def succeeds(*arguments: object, command: Typer = app) -> Result:
    result = run(*arguments, command=command)
    assert result.exit_code == 0, result.output
    return result


def info_of(*arguments: object) -> str:
    """All that info says, in one line."""
    return " ".join(succeeds("info", *arguments).stdout.split())


def fails(code: int, *arguments: object, command: Typer = app) -> str:
    """The line that a failing command writes."""
    result = run(*arguments, command=command)
    assert result.exit_code == code, result.output
    (line,) = (line for line in result.stderr.splitlines() if line.startswith("error: "))
    assert "Traceback" not in result.output
    return line


def error_of(code: int, *arguments: object) -> FusionSlamError:
    """The error behind the line that a failing command writes."""
    result = run(*arguments)
    assert result.exit_code == code, result.output
    assert result.exception is not None and result.exception.__context__ is not None
    error = result.exception.__context__.__cause__
    assert isinstance(error, FusionSlamError)
    return error


def refusal(code: int, *arguments: object) -> tuple[str, ...]:
    """Code and fields of the error of a failing command."""
    error = error_of(code, *arguments)
    return error.code, *error.fields


def table(path: Path) -> list[dict[str, str]]:
    """The rows of a CSV file."""
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def last_line(result: Result) -> str:
    return result.stdout.splitlines()[-1]


def vectors(path: Path) -> bytes:
    return DescriptorRun.load(path).descriptors.tobytes()


def fusionslam_descriptors() -> tuple[str, ...]:
    return USUAL
