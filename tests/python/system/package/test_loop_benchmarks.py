# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Tables of the benchmarks of loops, against figures counted by hand."""

import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.accuracy import loop_peers, recorded_loops, verified_loops
from benchmarks.accuracy.loop_peers import FIGURES, HEADER, PROTOCOLS, rows
from benchmarks.accuracy.verified_loops import ALL, figures_of
from fusionslam import Cloud
from fusionslam.evaluation import Evaluation, evaluate_verified
from verified import verified_run


def test_figures_are_the_mean_and_range_over_towns_by_direction() -> None:
    town = evaluate_verified(verified_run(), window=0)
    # Another town, without the crossing revisit, whose last loop is wrong by pose, too.
    poses = verified_run().match_from_query.copy()
    poses[8, 0, 3] += 3
    other = verified_run(match_from_query=poses).only(town.run.frames[[0, 1, 2, 3, 4, 5, 6, 8]])
    towns = [[town], [evaluate_verified(other, window=0)]]
    shown = {
        (row[2], row[3]): dict(zip(verified_loops.HEADER[4:], row[4:], strict=True))
        for row in verified_loops.rows(towns)
    }
    full = shown["pose-2m-5deg", "recall at 100 % precision"]
    assert full[ALL] == "0.250 (0.000 to 0.500)"
    assert full["opposite"] == "0.500 (0.000 to 1.000)"
    assert full["crossing"] == "0.000"  # of the first town alone
    assert shown["pose-2m-5deg", "top-1"]["opposite"] == "1.000 (1.000 to 1.000)"
    assert shown["pose-2m-5deg", "wrong ones accepted"] == {
        ALL: "0.500 (0.000 to 1.000)",
        **dict.fromkeys(("same", "opposite", "crossing"), ""),
    }
    assert figures_of(town)["pose-1m-5deg", "recall of the accepted"] == {
        ALL: 0.25,
        "same": 0,
        "opposite": 0.5,
        "crossing": 0,
    }


def test_recorded_loops_are_judged_by_their_poses() -> None:
    found = recorded_loops.judge(verified_run())
    assert found.metres[[4, 5, 8]] == pytest.approx([0.99, 1.5, 0], abs=1e-6)
    assert np.flatnonzero(found.right).tolist() == [7, 8]  # 6 is 5.2 degrees off, 7 only 4.8
    assert np.flatnonzero(found.certain).tolist() == [8]  # 4 is wrong and more probable than 7


def test_a_revisit_of_a_recording_looks_the_same_way_and_is_old_enough() -> None:
    seconds = 10**9 * np.array([0, 10, 20, 30, 40, 50, 60, 70, 80])
    run = verified_run(stamps_ns=seconds)
    assert np.flatnonzero(recorded_loops.find_revisits(run, 2.5, 20)).tolist() == [6]
    assert np.flatnonzero(recorded_loops.find_revisits(run, 2.5, 100)).tolist() == [6, 7]
    assert np.flatnonzero(recorded_loops.find_revisits(run, 0.9, 100)).tolist() == [7]
    recent = verified_run(stamps_ns=seconds // 10)
    assert not recorded_loops.find_revisits(recent, 2.5, 180).any()


def test_a_row_of_a_peer_has_its_figures_and_times_and_their_ratio_to_ours() -> None:
    def town(**milliseconds: float) -> list[Evaluation]:
        run = verified_run()
        timed = [
            replace(run, descriptors=(name,), seconds={"match": np.full(len(run), each / 1e3)})
            for name, each in milliseconds.items()
        ]
        return [evaluate_verified(each, window=0, protocols=PROTOCOLS) for each in timed]

    towns = [town(fusionslam=2, steady=10, fails=1), town(fusionslam=4, steady=8)]
    found = {tuple(row[:2]): dict(zip(HEADER, row, strict=True)) for row in rows(towns)}
    assert len(found) == 3 * len(PROTOCOLS)
    steady = found["steady", "pose-1m-5deg"]
    assert steady["ms a frame"] == "9.000 (8.000 to 10.000)"
    assert steady["times ours"] == "3.500 (2.000 to 5.000)"
    assert found["fails", "revisit"]["times ours"] == "0.500"
    known = figures_of(town(fusionslam=1)[0])
    for figure in FIGURES:
        value = known["pose-1m-5deg", figure][ALL]
        assert steady[figure] == f"{value:.3f} ({value:.3f} to {value:.3f})"


def test_peers_that_cannot_be_installed_are_left_out_with_the_reason(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail(command: list[str], **options: object) -> None:
        raise subprocess.CalledProcessError(1, command, "", "ERROR: no network\n")

    monkeypatch.setattr(loop_peers, "cache_folder", lambda: tmp_path)
    monkeypatch.setattr(loop_peers.subprocess, "run", fail)
    monkeypatch.setattr(loop_peers.venv, "create", lambda folder, **options: folder.mkdir())
    for _ in range(2):  # it is tried again
        assert loop_peers.peers_python() is None
        assert "no network" in capsys.readouterr().err
        (folder,) = tmp_path.iterdir()
        folder.rmdir()
    monkeypatch.setattr(loop_peers.venv, "create", fail)  # Debian without python3-venv
    assert loop_peers.peers_python() is None
    assert "no network" in capsys.readouterr().err


def test_a_peer_that_fails_is_left_out_with_the_reason(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    python = tmp_path / "python"
    python.write_text("#!/bin/sh\necho Traceback >&2\necho libX.so is missing >&2\nexit 1\n")
    python.chmod(0o755)
    clouds = [Cloud(np.zeros((3, 3), np.float32))]
    assert not list(loop_peers.run_peers(python, clouds, np.eye(4)[None]))
    assert capsys.readouterr().err.count("libX.so is missing") == len(loop_peers.PEERS)
