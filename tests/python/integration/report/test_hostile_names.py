# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Names from data stay text in every page, and never lead out of the folder of a report."""

import re
from collections.abc import Callable
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from descriptor_runs import camera_laps, descriptor_run
from fusionslam.errors import DataError
from fusionslam.evaluation import evaluate
from fusionslam.evaluation.views.run import ViewRun
from fusionslam.report import write_ratslam_report, write_report, write_view_report
from maps import square_run
from pages import read_page
from rows import rows

pytest.importorskip("matplotlib")

MARKUP = " ".join(
    [
        "<script>alert(1)</script>",
        '"><img src=x onerror=alert(1)>',
        "'><svg/onload=alert(1)>",
        "</style><script src=//x></script>",
        "--><iframe src=javascript:alert(1)>",
        "&lt;script&gt;alert(1)&lt;/script&gt;",
        "{{ 7 * 7 }}{% for x in y %}",
        "javascript:alert(1)",
        "\u202egnp.exe \U0001f916 {} %s%n",
        "=cmd|' /C calc'!A0",
    ]
)
NAMES = [MARKUP, "../../../outside", "x" * 300]


def loops(name: str, folder: Path) -> Path:
    poses = camera_laps(60)
    named = {"descriptor": f"../{name[:40]}", "dataset": name, "skipped": {99: name}}
    run = descriptor_run(poses[:, :3, 3], poses=poses, config={name: name}, **named)
    words = {"dataset_name": name, "command": name, "config": {name: name}, "notes": [name]}
    return write_report([evaluate(run)], folder, title=name, **words)


def views(name: str, folder: Path) -> Path:
    poses = np.stack([np.arange(30.0) % 15, np.zeros(30), np.zeros(30)], axis=1)
    ids = np.arange(30) % 15
    runs = [
        ViewRun(name, method, ids, poses, np.arange(30.0), config={name: name})
        for method in (name, "other")
    ]
    return write_view_report(runs, folder, command=name, notes=[name], title=name)


def maps(name: str, folder: Path) -> Path:
    named = {"name": name, "views": name, "odometry": name, "notes": [name], "why": [name] * 8}
    run = square_run(**named, config={name: name})
    return write_ratslam_report(folder, [run], command=name, notes=[name])


class Live(HTMLParser):
    """Collects what a browser would run or load."""

    def __init__(self) -> None:
        super().__init__()
        self.found: list[tuple[str, str, str | None]] = []

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        if tag in ("script", "iframe", "svg", "object", "embed", "base"):
            self.found.append((tag, "", None))
        for key, value in attributes:
            loads = key in ("href", "src", "srcset", "action", "data")
            text = value or ""
            beside = text.startswith(("#", "data:image/")) or not re.search(r"[:/]|\.\.", text)
            if key.startswith("on") or (loads and not beside):
                self.found.append((tag, key, value))


@pytest.mark.parametrize("write", [loops, views, maps])
def test_hostile_names_are_text_in_pages_and_files_stay_in_the_folder(
    write: Callable[[str, Path], Path], tmp_path: Path, unrendered: None
) -> None:
    plain = Live()
    plain.feed(write("plain", tmp_path / "plain").read_text("utf-8"))
    for number, name in enumerate(NAMES):
        folder = tmp_path / str(number) / "report"
        page = write(name, folder)
        live = Live()
        live.feed(page.read_text("utf-8"))
        assert [each[:2] for each in live.found] == [each[:2] for each in plain.found], name
        assert [path.name for path in folder.parent.iterdir()] == ["report"], name
        read_page(page)
    expected = {"plain", *map(str, range(len(NAMES)))}
    assert {path.name for path in tmp_path.iterdir()} == expected


@pytest.mark.parametrize("write", [loops, views, maps])
def test_hostile_names_are_rendered(write: Callable[[str, Path], Path], tmp_path: Path) -> None:
    assert write(MARKUP, tmp_path).is_file()


@rows("write", [loops, views, maps])
def test_unwritable_folders_are_named(write: Callable[[str, Path], Path], tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(DataError, match=str(tmp_path / "file")):
        write("plain", tmp_path / "file")
