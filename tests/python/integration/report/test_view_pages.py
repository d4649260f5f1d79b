# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The page on the evaluation of views says what the program says."""

import re
import shutil
from pathlib import Path
from typing import Any

import pytest

from fusionslam.evaluation import baselines, judge_views
from pages import DOCS, snippets
from recordings import scans_above_floor

PAGE = "stages/evaluation/views"


@pytest.fixture
def beside(tmp_path: Path, test_data: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    shutil.copy(test_data / "recordings" / "small_house.npz", tmp_path)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.nightly
def test_the_page_prints_what_it_says(beside: Path, capsys: pytest.CaptureFixture[str]) -> None:
    names: dict[str, Any] = {}
    for snippet in snippets(PAGE):
        exec(compile(snippet, f"{PAGE}.md", "exec"), names)
    text = (DOCS / f"{PAGE}.md").read_text(encoding="utf-8")
    (printed,) = re.findall(r"^```text\n(rule .*?)^```$", text, flags=re.MULTILINE | re.DOTALL)
    assert capsys.readouterr().out == printed
    assert names["curve"].at(names["threshold"])["loop_precision"] >= 0.97
    assert (beside / "out" / "views.html").is_file()


def test_the_table_of_programs_without_a_sensor_is_what_is_measured(test_data: Path) -> None:
    text = (DOCS / f"{PAGE}.md").read_text(encoding="utf-8")
    drives = [scans_above_floor(test_data, world) for world in ("warehouse", "small_house")]
    for name in baselines(1):
        shares = []
        for poses, stamps in drives:
            report = judge_views(baselines(len(poses))[name], poses, stamps)
            assert report.loop_recall == 0 and report.accuracy is not None
            shares.append(f"{100 * report.accuracy:.1f} %")
        assert f"| {name} | {' | '.join(shares)} | 0 |" in text
    author = [
        judge_views(baselines(len(poses))["new every 3rd"], poses, stamps, rule="author").accuracy
        for poses, stamps in drives
    ]
    assert "scores {:.1f} and {:.1f} %".format(*(100 * (share or 0) for share in author)) in text
