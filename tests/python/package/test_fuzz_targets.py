# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""A short run of every target of fuzz/: damaged files, forged files, hostile arguments."""

from pathlib import Path

import pytest
import typer

from fuzz import supervisor
from fuzz.__main__ import main
from fuzz.short_run import FORMER_FINDINGS, short_run
from fuzz.targets import all_targets
from fuzz.worker_counts import Counts

TARGETS = all_targets()


@pytest.mark.parametrize("name", TARGETS)
def test_hostile_input_is_refused_or_harmless(name: str) -> None:
    assert short_run(TARGETS[name], 30) >= 10


def test_every_former_finding_belongs_to_a_target() -> None:
    folders = {folder.name for folder in FORMER_FINDINGS.glob("*")}
    assert folders <= {name.replace("/", "-") for name in TARGETS}


def test_a_resumed_run_tries_targets_with_findings_or_too_few_inputs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    targets = ["functions/m2dp", "functions/shot"]
    ran: list[str] = []
    findings = {"functions/shot"}

    def run(name: str, where: Path, inputs: int, seed: int) -> int:
        ran.append(name)
        counts = Counts(where)
        for _ in range(inputs):
            counts.add("refused")
        if name in findings:
            (where / "findings").mkdir()
            (where / "findings" / "untyped-1.txt").touch()
        return 0

    def fuzz(inputs: int, resume: bool) -> list[str]:
        ran.clear()
        with pytest.raises(typer.Exit):
            main(inputs, target=targets, jobs=1, output=tmp_path, resume=resume)
        return sorted(ran)

    monkeypatch.setattr(supervisor, "_run", run)
    assert fuzz(10, resume=False) == targets
    findings.clear()
    assert fuzz(10, resume=True) == ["functions/shot"]
    assert fuzz(11, resume=True) == targets
    assert fuzz(11, resume=True) == []
