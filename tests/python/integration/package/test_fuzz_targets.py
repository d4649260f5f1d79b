# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""A short run of every target of fuzz/: damaged files, forged files, hostile arguments."""

import random
from itertools import islice
from pathlib import Path

import pytest
import typer

from fuzz import supervisor
from fuzz.__main__ import main
from fuzz.any_arguments import calls, check
from fuzz.crafted_files import CRAFTED, read_in_a_process
from fuzz.short_run import FORMER_FINDINGS, short_run
from fuzz.targets import all_targets
from fuzz.worker_counts import Counts

TARGETS = all_targets()


@pytest.mark.nightly
@pytest.mark.parametrize("name", TARGETS)
def test_hostile_input_is_refused_or_harmless(name: str) -> None:
    assert short_run(TARGETS[name], 30) >= 10


@pytest.mark.slow
@pytest.mark.parametrize("group", sorted({name.partition("/")[0] for name in TARGETS}))
def test_some_hostile_inputs_are_refused_or_harmless(group: str) -> None:
    for name, target in TARGETS.items():
        # A seed of place maps takes as long as those of all others.
        if name.startswith(f"{group}/") and name != "damaged/place_map":
            assert short_run(target, 3) >= 1, name


def test_calls_with_arguments_of_any_type_are_refused_or_answered(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for name, call in islice(calls(random.Random(1)), 200):
        assert check(call) is None, name


def test_every_former_finding_belongs_to_a_target() -> None:
    folders = {folder.name for folder in FORMER_FINDINGS.glob("*")}
    assert folders <= {name.replace("/", "-") for name in TARGETS}


def test_a_resumed_run_counts_the_inputs_of_targets_without_findings(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    targets = ["functions/m2dp", "functions/shot"]
    ran: dict[str, int] = {}
    findings = {"functions/shot"}

    def run(name: str, where: Path, inputs: int, seed: int) -> int:
        ran[name] = inputs
        counts = Counts(where)
        for _ in range(inputs):
            counts.add("refused")
        if name in findings:
            (where / "findings").mkdir()
            (where / "findings" / "untyped-1.txt").touch()
        return 0

    def fuzz(inputs: int, resume: bool) -> dict[str, int]:
        ran.clear()
        with pytest.raises(typer.Exit):
            main(inputs, target=targets, jobs=1, output=tmp_path, resume=resume)
        return dict(ran)

    monkeypatch.setattr(supervisor, "_run", run)
    assert fuzz(10, resume=False) == dict.fromkeys(targets, 10)
    findings.clear()
    assert fuzz(10, resume=True) == {"functions/shot": 10}
    assert fuzz(15, resume=True) == dict.fromkeys(targets, 5)
    assert fuzz(15, resume=True) == {}
    assert fuzz(15, resume=False) == dict.fromkeys(targets, 15)


@pytest.mark.parametrize("step", [9, pytest.param(1, marks=pytest.mark.nightly)])
def test_crafted_files_are_refused_in_little_time_and_memory(step: int) -> None:
    pytest.importorskip("onnx", reason="writes networks")
    pytest.importorskip("faiss", reason="reads segments")
    names = [*[*CRAFTED][::step], ".faiss: vast rows"]
    ends = {name: read_in_a_process(CRAFTED[name]) for name in names}
    assert {name: end for name, end in ends.items() if not end.is_good} == {}
