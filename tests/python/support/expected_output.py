# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Runs the commands listed in ``expected/*.txt`` and writes down what they print.

A file holds commands, each a line that begins with "$ fusionslam", and below each its output. To
add a case, add such a line and run ``update_expected.py``. Names in capitals stand for data made
here and for OUT, a folder that the commands of one file share.
"""

import math
import os
import re
import shlex
import textwrap
from collections.abc import Callable
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
import typer.main

from bags import drive as drive_events
from bags import write_bag
from cli import FRAMES, run
from fleets import write_fleet
from fusionslam.cli import app
from fusionslam.datasets import write_cloud
from fusionslam.sensors.frame import Cloud
from kitti import write_sequence
from project import PROJECT
from recordings import write_drive
from scenes import LAPS, drive, write_recording

EXPECTED = PROJECT / "tests/python/integration/cli/expected"
_PROMPT = "$ fusionslam "
_SPACE = "\xa0"  # at which no line is broken


def _make_kitti(path: Path) -> None:
    places = [min(n, FRAMES - n) for n in range(FRAMES)]
    write_sequence(path, places, [500] * FRAMES, metres=20, width=128)


def _make_clouds(path: Path) -> None:
    """Clouds without colours."""
    points = np.random.default_rng(1).uniform(-9, 9, (300, 3)).astype(np.float32)
    for number in range(3):
        write_cloud(path / f"clouds/{number:06d}.bin", Cloud(points + number))


DATA: dict[str, tuple[str, Callable[[Path], object]]] = {
    "KITTI": ("kitti", _make_kitti),
    "CLOUDS": ("clouds", _make_clouds),
    "EMPTY": ("empty", Path.mkdir),
    "BAG": ("drive.bag", lambda path: write_bag(path, drive_events())),
    "DRIVE": ("drive.npz", write_drive),
    "RANGES": ("ranges.npz", lambda path: write_recording(path, LAPS)),
    "SCENES": ("scenes.npz", lambda path: drive((*LAPS, -1)).save(path)),
    "PLAIN": ("plain.npz", lambda path: drive(LAPS, poses=False).save(path)),
    "FLEET": ("fleet", write_fleet),
    "OUT": ("out", lambda path: None),
}
"""By the name in a command: name and maker of a file or folder."""


def transcript(text: str, folder: Path) -> str:
    """The file anew: each command of a file, followed by what it prints now.

    Args:
        text: of the file.
        folder: an empty one for data and results.
    """
    commands = [line for line in text.splitlines() if line.startswith(_PROMPT)]
    return "\n".join(
        f"{command}\n{_output(shlex.split(command)[2:], folder)}" for command in commands
    )


def _output(words: list[str], folder: Path) -> str:
    if words[-1] == "--help":
        return _help(words[:-1])
    places = {name: folder / file for name, (file, _) in DATA.items()}
    pattern = re.compile(rf"\b({'|'.join(DATA)})\b")
    for name in pattern.findall(" ".join(words)):
        if not places[name].exists():
            DATA[name][1](places[name])
    with mock.patch("fusionslam.cli.console._PERIOD", math.inf):
        result = run(*(pattern.sub(lambda found: str(places[found[0]]), word) for word in words))
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    text = result.stdout + result.stderr
    for name, path in places.items():
        text = text.replace(str(path.resolve()), name)
    text = text.replace(str(folder), "FOLDER")
    # Times differ from run to run, widths of tables with the length of paths.
    text = re.sub(r"\d+\.\d+ ms", "# ms", text)
    lines = [re.sub(r" {2,}", "  ", re.sub("─+", "─", line)).rstrip() for line in text.split("\n")]
    status = f"[exit {result.exit_code}]\n" if result.exit_code else ""
    return "\n".join(lines) + status


def _help(words: list[str]) -> str:
    """Commands with their purpose, and options with their values, without typer's layout."""
    program = typer.main.get_command(app)
    command = commands_of(program)[" ".join(words)]
    lines = []
    for name, each in getattr(command, "commands", {}).items():
        lines.append(f"  {name}: {(each.help or '').partition(chr(10))[0]}")
    options = ", ".join(_names(each) for each in command.params if getattr(each, "help", None))
    lines.extend(textwrap.wrap(options, 98, break_long_words=False, break_on_hyphens=False))
    return "\n".join(lines).replace(_SPACE, " ") + "\n"


def commands_of(command: Any, name: str = "") -> dict[str, Any]:
    """Each command by its words, those of groups too."""
    found = {name: command}
    for word, inner in getattr(command, "commands", {}).items():
        found |= commands_of(inner, f"{name} {word}".strip())
    return found


def _names(option: Any) -> str:
    """The names of an option or argument, and its values."""
    words = option.opts if option.opts[0].startswith("-") else []
    return _SPACE.join([*words, *([option.metavar] if option.metavar else [])])


def update(folder: Path) -> None:
    """Write every file anew; data are made below a folder."""
    os.environ["FUSIONSLAM_CACHE"] = str(folder / "cache")
    for path in sorted(EXPECTED.glob("*.txt")):
        own = folder / path.stem
        own.mkdir()
        path.write_text(transcript(path.read_text(), own))
