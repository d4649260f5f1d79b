# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""bench over worlds of several seeds, and whose loops it proves."""

import json
from pathlib import Path
from typing import Any

import pytest

from cli import NO_WINDOW, error_of, succeeds, table
from error_codes import has_code
from fusionslam.errors import ConfigError
from fusionslam.sim import recordings
from fusionslam.sim.recordings import record_seed
from rows import rows

FAST = ("--verify", "none", "--source", "lidar", *NO_WINDOW)


@pytest.fixture
def made(kitti: Path, monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """The seeds of the worlds that were asked for; each is the drive of the other tests."""
    seeds: list[int] = []

    def give(name: str, seed: int, **options: Any) -> Path:
        assert name == "town"
        seeds.append(seed)
        return kitti

    monkeypatch.setattr(recordings, "record_seed", give)
    return seeds


def test_bench_over_seeds_prints_and_writes_mean_and_range(made: list[int], tmp_path: Path) -> None:
    names = ("-d", "m2dp:author,m2dp:paper")
    result = succeeds("bench", "town", "--seeds", "1,2", *names, *FAST, "-o", tmp_path)
    assert made == [1, 2]
    assert "m2dp author" in result.stdout and "m2dp paper" in result.stdout
    assert str(tmp_path / "comparison.html") in result.stdout
    rows = table(tmp_path / "comparison.csv")
    assert [(row["recording"], row["descriptor"]) for row in rows] == [
        (world, name) for world in ("town 1", "town 2") for name in ("m2dp:author", "m2dp:paper")
    ]
    figures = json.loads((tmp_path / "seed-2" / "metrics.json").read_text())
    assert [run["preset"] for run in figures["runs"]] == ["author", "paper"]
    assert not (tmp_path / "seed-2" / "report.html").exists()
    words = ("--seeds", "3", "-d", "m2dp", "--no-report", "-o", tmp_path / "alone")
    assert "comparison.csv" in succeeds("bench", "town", *words, *FAST).stdout
    assert not (tmp_path / "alone/comparison.html").exists()


@rows(
    "words, fields",
    [
        *(
            (("town", f"--seeds={text}"), ("--seeds", text))
            for text in ("one", "1,,2", "-1", "1.5")
        ),
        (("town", "--seeds", "1", "--sequence", "03"), ("--sequence", "03")),
        (("KITTI", "--seeds", "1"), None),  # only made worlds have seeds
        (("KITTI", "--verify", "every"), ("--verify", "every")),
    ],
)
def test_seeds_are_whole_numbers_of_made_worlds(
    made: list[int], kitti: Path, words: tuple[str, ...], fields: tuple[str, ...], tmp_path: Path
) -> None:
    given = (kitti if word == "KITTI" else word for word in words)
    error = error_of(2, "bench", *given, "-o", tmp_path / "out")
    assert error.code == "choice"
    assert error.fields == fields or (fields is None and error.fields[1] == str(kitti))
    unknown = ("bench", "town", "--seeds", "1", "-d", "m2dp:best")
    assert isinstance(error_of(2, *unknown), ConfigError)
    assert not made and not (tmp_path / "out").exists()


def test_a_seed_is_of_world_drive_noise(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("FUSIONSLAM_CACHE", str(tmp_path))
    seen: dict[str, Any] = {}

    def note(kind: str, config: Any) -> Path:
        seen[kind] = config
        return tmp_path

    monkeypatch.setattr(recordings, "record", lambda config, folder, **_: note(folder.name, config))
    monkeypatch.setattr(recordings, "embedded_bag", lambda name, config, **_: note(name, config))
    record_seed("town", 5)
    record_seed("house", 6)
    assert (seen["town-5"].seed, seen["town-5"].town.seed) == (5, 5)
    house = seen["house"]
    assert (house.seed, house.world.seed, house.plan.seed) == (6, 6, 6)
    with pytest.raises(ConfigError, check=has_code("choice", "moon")):
        record_seed("moon", 1)
