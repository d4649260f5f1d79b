# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Commands about views, given what does not go together."""

from pathlib import Path

import pytest

from cli import error_of, fails, succeeds
from scenes import LAPS, drive, write_recording


@pytest.fixture()
def scenes(tmp_path: Path) -> Path:
    path = tmp_path / "scenes.npz"
    drive((*LAPS, -1)).save(path)
    return path


@pytest.mark.parametrize("words", [("views", "match"), ("views", "curve"), ("tune",)])
@pytest.mark.parametrize("size", [0, 10, 2000])
def test_a_set_that_is_cut_is_said_to_be(
    words: tuple[str, ...], size: int, scenes: Path, tmp_path: Path
) -> None:
    scenes.write_bytes(scenes.read_bytes()[:size])
    assert "scenes.npz" in fails(1, *words, scenes, "-o", tmp_path / "out")


@pytest.mark.parametrize(
    ("option", "value"), [("--gt", "poses.txt"), ("--kind", "folder"), ("--sequence", "07")]
)
def test_what_would_not_be_heard_is_refused(
    option: str, value: str, scenes: Path, tmp_path: Path
) -> None:
    ranges = tmp_path / "ranges.npz"
    write_recording(ranges, LAPS)
    for data in (scenes, ranges):
        for command in ("match", "curve", "record"):
            line = fails(2, "views", command, data, "-o", tmp_path / "out", option, value)
            assert option in line and str(data) in line


@pytest.mark.parametrize("method", ["alignment", "objects"])
def test_scenes_alone_are_matched_by_every_method_that_compares_them(
    method: str, scenes: Path, tmp_path: Path
) -> None:
    chosen = ("--set", f"views.method={method}", "--no-report")
    small = tmp_path / "small.npz"
    succeeds("views", "record", scenes, "-o", small, "--only-scenes")
    for path in (scenes, small):
        succeeds("views", "match", path, "-o", tmp_path / path.stem, *chosen)
    ids = [
        [line.split(",")[2] for line in (tmp_path / name / "matches.csv").read_text().splitlines()]
        for name in ("scenes", "small")
    ]
    assert ids[0] == ids[1] and ids[0][1] == "0"


@pytest.mark.parametrize(
    ("setting", "kind"),
    [
        ("views.method=cm2dp", "cm2dp"),
        ("views.preset=author", "objects"),
        ("views.second_stage=places", "two_stage"),
    ],
)
def test_a_set_without_clouds_says_what_it_lacks(
    setting: str, kind: str, scenes: Path, tmp_path: Path
) -> None:
    pytest.importorskip("onnxruntime")
    small = tmp_path / "small.npz"
    succeeds("views", "record", scenes, "-o", small, "--only-scenes")
    error = error_of(1, "views", "match", small, "-o", tmp_path / "out", "--set", setting)
    assert error.code == "no-clouds" and error.fields[0].startswith(kind)


def test_a_missing_extra_is_told_before_the_work_and_only_where_it_is_needed(
    scenes: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("fusionslam.cli.failures.find_spec", lambda name: None)
    plain = tmp_path / "plain.npz"
    drive(LAPS, poses=False).save(plain)
    out = tmp_path / "out"
    assert error_of(1, "views", "match", scenes, "-o", out).fields == ("report",)
    assert not (out / "matches.csv").exists()
    succeeds("views", "match", scenes, "-o", out, "--no-report")
    succeeds("views", "match", plain, "-o", out)
