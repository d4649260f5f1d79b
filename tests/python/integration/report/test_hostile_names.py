# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Names from data stay text in every page, and never lead out of the folder of a report."""

from collections.abc import Callable
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from fusionslam.evaluation import DescriptorRun, evaluate
from fusionslam.evaluation.views.run import ViewRun
from fusionslam.report import write_ratslam_report, write_report, write_view_report
from maps import square_run

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
    angle = np.linspace(0, 4 * np.pi, 60)
    poses = np.tile(np.eye(4), (60, 1, 1))
    poses[:, 0, 3], poses[:, 2, 3] = 60 * np.sin(angle), 40 * np.cos(angle)
    run = DescriptorRun(
        source="lidar",
        descriptor="m2dp",
        dataset=name,
        descriptors=poses[:, :3, 3].astype(np.float32),
        frames=np.arange(60),
        stamps_ns=np.arange(60) * 10**8,
        poses=poses,
        seconds={"load": np.ones(60)},
        peak_memory_bytes=1,
        points=np.full(60, 9),
        config={name: name},
        skipped={99: name},
    )
    write_report(
        [evaluate(run)],
        folder,
        dataset_name=name,
        command=name,
        config={name: name},
        title=name,
        notes=[name],
    )
    return folder / "report.html"


def views(name: str, folder: Path) -> Path:
    poses = np.stack([np.arange(30.0) % 15, np.zeros(30), np.zeros(30)], axis=1)
    ids = np.arange(30) % 15
    runs = [
        ViewRun(name, method, ids, poses, np.arange(30.0), config={name: name})
        for method in (name, "other")
    ]
    return write_view_report(runs, folder, command=name, notes=[name], title=name)


def maps(name: str, folder: Path) -> Path:
    run = replace(square_run(), name=name, views=name, odometry=name, notes=[name])
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
            if key.startswith("on") or (loads and not _is_beside(text)):
                self.found.append((tag, key, value))


def _is_beside(link: str) -> bool:
    return link.startswith(("#", "data:image/")) or not (":" in link or "/" in link or ".." in link)


@pytest.mark.parametrize("write", [loops, views, maps])
def test_hostile_names_are_text_in_pages_and_files_stay_in_the_folder(
    write: Callable[[str, Path], Path], tmp_path: Path
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
    expected = {"plain", *map(str, range(len(NAMES)))}
    assert {path.name for path in tmp_path.iterdir()} == expected
