# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The first program of docs/stages/ratslam.md prints what stands below it."""

import math
import re
from pathlib import Path

import pytest

from project import PROJECT

PAGE = PROJECT / "docs" / "stages" / "ratslam.md"
NUMBER = r"-?\d+(?:\.\d+)?"


def said(line: str) -> tuple[str, list[float]]:
    """The words of a line, and its numbers."""
    return re.sub(NUMBER, "", line), [float(number) for number in re.findall(NUMBER, line)]


def test_the_square_of_the_docs_ends_as_they_say(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    text = PAGE.read_text(encoding="utf-8")
    found = re.search(
        r"```python\n(.*?)```\n\n```text\n(.*?)\n\.\.\.\n(.*?)\n```\n(.*)", text, re.DOTALL
    )
    assert found is not None
    program, first, last, after = found.groups()
    monkeypatch.chdir(tmp_path)
    exec(program, {})
    lines = capsys.readouterr().out.splitlines()
    shown = [first, *last.splitlines()]
    for line, wanted in zip([lines[0], *lines[-2:]], shown, strict=True):
        words, numbers = said(line)
        assert words == said(wanted)[0]
        assert numbers == pytest.approx(said(wanted)[1], abs=0.002)
    # Where the robot truly is at the last view.
    x, y = map(float, re.findall(r"\((\S+), (\S+), \S+\)", lines[-2])[0])
    (told,) = re.findall(r"the map is off by (\S+) m", after)
    assert math.hypot(x + 0.1, y - 0.2) == pytest.approx(float(told), abs=0.05)
    assert (tmp_path / "map.npz").is_file()
