# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Both theses measured again: a small recording in the place of a world."""

import json
import logging
import re
from functools import partial
from pathlib import Path
from typing import Any

import pytest

import cli
from artefacts import artefact, copy_artefact
from benchmarks.theses import map_study, view_study
from benchmarks.theses.__main__ import app
from benchmarks.theses.conclusions import _SHOWN, Claim, Operand, decide
from benchmarks.theses.config import ReproduceConfig
from benchmarks.theses.descriptor_study import study_descriptors
from benchmarks.theses.differences import Difference, differences_table, met_sentence
from benchmarks.theses.run import reproduce
from benchmarks.theses.stastny2022_chapter5 import find_published
from error_codes import has_code
from fusionslam.errors import ConfigError, DataError
from fusionslam.evaluation.loops.published import (
    PUBLISHED_COLOR_SPACES,
    PUBLISHED_MATCH_SECONDS,
    PUBLISHED_RECALL,
    PUBLISHED_SECONDS,
)
from recordings import write_drive
from rows import rows

pytest.importorskip("matplotlib")
pytest.importorskip("jinja2")


def never(*arguments: Any) -> Any:
    raise AssertionError("worked for nothing")


fails = partial(cli.fails, command=app)
CHAPTER4 = ("recall", "describe_ms")
succeeds = partial(cli.succeeds, command=app)
VIEWS = ("objects:author", "visual_templates", "alignment")


def write_data(folder: Path, laps: int = 2) -> Path:
    (folder / "recordings").mkdir(parents=True)
    write_drive(folder / "recordings" / "warehouse.npz", laps=laps)
    return folder


@pytest.fixture(scope="module")
def data() -> Path:
    return artefact("theses", write_data)


def kitti_named(kitti: Path, number: str, target: Path) -> str:
    """A copy of the drive as another sequence of KITTI."""
    copy_artefact(kitti.parent.parent, target)
    (target / "sequences/03").rename(target / f"sequences/{number}")
    (target / "poses/03.txt").rename(target / f"poses/{number}.txt")
    return str(target)


def config_of(data: Path, **changes: Any) -> ReproduceConfig:
    values: dict[str, Any] = {"worlds": ("warehouse",), "views": VIEWS, "data": str(data)}
    return ReproduceConfig(**values | {"parts": ("views", "maps")} | changes)


@pytest.fixture(scope="module")
def made(data: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("made")
    assert reproduce(config_of(data), folder, command="typed") == folder / "reproduce.html"
    return folder


@pytest.fixture
def again(made: Path, tmp_path: Path) -> Path:
    """A finished folder that a test may change."""
    return copy_artefact(made, tmp_path / "again")


def pieces_of(folder: Path) -> dict[str, int]:
    return {path.name: path.stat().st_mtime_ns for path in (folder / "pieces").iterdir()}


def rows_under(folder: Path, title: str) -> list[list[str]]:
    """The rows of the tables whose titles begin so: headings first."""
    text = (folder / "reproduce.md").read_text()
    (table,) = re.findall(rf"^\*\*{re.escape(title)}.*?\*\*\n\n((?:\|.*\n)+)", text, re.MULTILINE)
    lines = [line for line in table.splitlines() if not line.startswith("|--")]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]


def test_published_figures_are_those_of_the_theses() -> None:
    assert PUBLISHED_RECALL["06", "lidar", "cm2dp"] == 0.824701
    assert PUBLISHED_RECALL["07", "stereo", "cshot"] == 0.442105
    assert PUBLISHED_COLOR_SPACES == {
        "rgb": (0.825, 0.892),
        "hsv": (0.714, 0.915),
        "lab": (0.498, 0.868),
    }
    assert PUBLISHED_SECONDS["05", "stereo", "cshot"] == 1.7711
    assert PUBLISHED_MATCH_SECONDS["05", "lidar", "cm2dp"] == 0.0051
    assert PUBLISHED_MATCH_SECONDS["05", "stereo", "cshot"] == 0.0061
    assert find_published("warehouse", "objects:author", "accuracy") == pytest.approx(0.8884)
    assert find_published("house", "visual_templates", "accuracy") == pytest.approx(0.4125)
    assert find_published("hospital", "visual_templates", "max_error") == 14.57
    assert find_published("house", "two_stages:author", "build_ms") == 88.265
    assert find_published("hospital", "two_stages:author", "views") == 148
    assert find_published("warehouse", "alignment", "accuracy") is None


@pytest.mark.nightly
@rows(
    "title, figures",
    [
        ("Table 5.2, accuracy in %, the thesis's set-up", ("88.8", "77.7")),
        ("Table 5.2, accuracy in %, strictly", ("88.8", "77.7")),
        ("Table 5.2, accuracy in %, not tried in the thesis", ("88.8", "77.7")),
        ("Table 5.3, average distance in m, the thesis's set-up", ("1.32", "8.93")),
        ("Table 5.3, largest distance in m, strictly", ("3.06", "11.52")),
        ("Table 5.4, building a view", ("42.432", "2.053")),
        ("Table 5.4, comparing two views", ("0.153", "0.083")),
        ("Table 5.5, bytes of a view", ("78", "600")),
        ("Table 5.5, views stored, the thesis's set-up", ("194", "312")),
        ("RMSE of the nodes in m, the thesis's set-up", ("satisfactory",)),
    ],
)
def test_every_table_has_the_published_figure_beside_ours(
    made: Path, title: str, figures: tuple[str, ...]
) -> None:
    if title.startswith("RMSE"):
        title += ": perfect odometry; RatSLAM as the thesis used it"
    heads, row = rows_under(made, title)
    assert row[0] == "warehouse"
    first = heads.index("1st stage")
    assert heads[first + 1] == "thesis"
    assert row[first + 1] == figures[0]
    if "distance" not in title:
        assert float(row[first]) >= 0
        assert float(row[heads.index("ours")]) >= 0
    if len(figures) > 1:
        assert row[heads.index("original RatSLAM") + 1] == figures[1]


@pytest.mark.nightly
def test_the_page_holds_what_the_markdown_says_and_every_picture(made: Path) -> None:
    page, text = (made / "reproduce.html").read_text(), (made / "reproduce.md").read_text()
    for heading in re.findall(r"^## (.*)$", text, flags=re.MULTILINE):
        assert heading.replace("'", "&#39;") in page
    assert "typed" in page
    assert page.count("<img") == len(list(made.glob("*.png"))) >= 5
    assert {"maps_warehouse_exact.png", "maps_warehouse_drift.png"} <= {
        path.name for path in made.glob("*.png")
    }
    assert "http" not in re.sub(r"http-equiv", "", page)


@pytest.mark.nightly
def test_what_cannot_be_had_is_named_and_costs_nothing_else(made: Path) -> None:
    text = (made / "reproduce.md").read_text()
    assert "Missing: warehouse: templates: no images." in text
    heads, row = rows_under(made, "Table 5.2, accuracy in %, strictly")
    assert row[heads.index("original RatSLAM")] == "\N{EN DASH}"


@pytest.mark.nightly
def test_figures_say_what_the_tables_say(made: Path) -> None:
    content = json.loads((made / "reproduce.json").read_text())
    wanted = ("warehouse", "robot", "objects:author")
    (found,) = (v for v in content["views"] if (v["world"], v["frame"], v["method"]) == wanted)
    heads, row = rows_under(made, "Table 5.2, accuracy in %, strictly")
    assert row[heads.index("1st stage")] == f"{100 * found['figures']['accuracy']:.1f}"
    maps = {(m["odometry"], m["method"], m["preset"]): m for m in content["maps"]}
    assert len(maps) == 2 * (2 * 2 + 1)
    assert maps["truth", "alignment", "robust"]["report"]["node_count"] > 1
    assert maps["truth", "visual_templates", "robust"]["report"] is None


@pytest.mark.nightly
def test_the_same_command_again_recomputes_nothing(
    again: Path, data: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    text, before = (again / "reproduce.md").read_text(), pieces_of(again)
    monkeypatch.setattr(view_study, "sweep_thresholds", never)
    monkeypatch.setattr(map_study, "run_events", never)
    reproduce(config_of(data, views=("objects:author", "alignment")), again, command="typed")
    assert pieces_of(again) == before
    assert "88.8" in text


@pytest.mark.nightly
def test_a_run_that_is_cut_goes_on_where_it_stopped(
    data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    config = config_of(data, views=("objects:author",), parts=("maps",))
    done: list[Any] = []
    mapping = map_study.run_events

    def cut(*arguments: Any) -> None:
        if len(done) == 2:
            raise KeyboardInterrupt
        done.append(arguments)
        mapping(*arguments)

    monkeypatch.setattr(map_study, "run_events", cut)
    with pytest.raises(KeyboardInterrupt):
        reproduce(config, tmp_path)
    kept = pieces_of(tmp_path)
    assert sum("-map-" in name for name in kept) == 2
    assert not (tmp_path / "reproduce.html").exists()
    done.clear()
    monkeypatch.setattr(map_study, "run_events", lambda *a: [done.append(a), mapping(*a)])
    reproduce(config, tmp_path)
    assert len(done) == 2
    assert kept.items() <= pieces_of(tmp_path).items()


@pytest.mark.nightly
def test_a_damaged_piece_is_made_again_and_named(
    again: Path, data: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (piece,) = (again / "pieces").glob("warehouse-objects-author-robot.*.npz")
    (curve,) = (again / "pieces").glob("warehouse-objects-author-robot-curve.*.json")
    (mapped,) = (again / "pieces").glob("warehouse-map-objects-author-truth-robust.*.npz")
    heads = rows_under(again, "Table 5.2, accuracy in %, strictly")
    for path in (piece, curve, mapped):
        path.write_bytes(path.read_bytes()[:100])
    with caplog.at_level(logging.WARNING):
        reproduce(config_of(data), again)
    told = [message for message in caplog.messages if message.endswith("made again")]
    assert len(told) == 3
    assert all(any(path.name in one for one in told) for path in (piece, curve, mapped))
    assert rows_under(again, "Table 5.2, accuracy in %, strictly") == heads


@pytest.mark.nightly
def test_other_scans_are_not_taken_for_the_same(again: Path, data: Path, tmp_path: Path) -> None:
    other = write_data(tmp_path / "other", laps=3)
    before = pieces_of(again)
    reproduce(config_of(other, views=("objects:author",), parts=("views",)), again)
    after = pieces_of(again)
    drive = [name for name in after if name.startswith("warehouse-drive")]
    assert len(drive) == 1 and drive[0] not in before


def test_missing_data_and_unknown_names_are_one_line(
    data: Path, tmp_path: Path, kitti: Path
) -> None:
    out = ("-o", tmp_path / "out")
    for more in ((), ("--parts", "descriptors")):
        line = fails(1, *out, "--data", tmp_path / "nothing", *more)
        assert "nothing" in line and "recordings" in line
        assert not (tmp_path / "out").exists()
    parts = ("--parts", "descriptors", "--data", data)
    line = fails(1, *out, *parts, "--kitti", tmp_path)
    assert "sequences/06" in line
    line = fails(1, *out, *parts, "--kitti", kitti.parent.parent)
    assert "sequences/06, sequences/05" in line
    # Before the views, which come first and take long.
    line = fails(1, "-o", tmp_path / "late", "--kitti", tmp_path / "nothing")
    assert "sequences/06, sequences/05" in line and not (tmp_path / "late/made_with.json").exists()
    assert "hospital" in fails(2, *out, "--worlds", "castle")
    assert "objects:author" in fails(2, *out, "--views", "crystal_ball")
    assert "maps" in fails(2, *out, "--parts", "")
    with pytest.raises(ConfigError, check=has_code("empty", "worlds")):
        reproduce(ReproduceConfig(worlds=()), tmp_path)


def test_a_folder_that_cannot_be_written_is_found_before_the_work(
    data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(view_study, "run_method", never)
    (tmp_path / "file").touch()
    for target in (tmp_path / "file" / "out", "/proc/nowhere"):
        with pytest.raises(DataError, check=has_code("cannot-write")):
            reproduce(config_of(data), target)


@pytest.mark.nightly
def test_the_command_prints_its_page(data: Path, tmp_path: Path) -> None:
    given = ("--data", data, "--worlds", "warehouse", "--parts", "views")
    given += ("--views", "objects:author")
    result = succeeds("-o", tmp_path, "--quick", *given)
    assert cli.last_line(result) == str(tmp_path / "reproduce.html")
    claims = json.loads((tmp_path / "reproduce.json").read_text())["claims"]
    assert claims and result.stdout.count("holds") >= sum("holds" in c["verdict"] for c in claims)
    assert "Figures of a quick run are no results" in (tmp_path / "reproduce.md").read_text()


@pytest.mark.nightly
def test_descriptors_of_kitti_stand_beside_what_was_published(
    kitti: Path, data: Path, tmp_path: Path
) -> None:
    root = kitti_named(kitti, "06", tmp_path / "kitti")
    config = config_of(data, parts=("descriptors",), kitti=root, quick=True)
    reproduce(config, tmp_path / "out")
    heads, row, *others = rows_under(tmp_path / "out", "Table 4.4")
    assert row[0] == "KITTI 06" and len(others) == 3
    assert row[heads.index("c-M2DP") + 1] == "0.824701"
    assert row[heads.index("CSHOT") + 1] == "0.818898"
    heads, *rows = rows_under(tmp_path / "out", "Table 4.2")
    assert [row[0] for row in rows] == ["M2DP", "c-M2DP", "CSHOT"]
    assert rows[1][2] == "83.0" and float(rows[1][1].split()[0]) > 0
    heads, *rows = rows_under(tmp_path / "out", "c-M2DP on KITTI 06")
    assert [row[4] for row in rows] == ["0.892", "0.915", "0.868"]


@pytest.mark.nightly
def test_what_their_author_stored_comes_out_again(
    test_data: Path, kitti: Path, tmp_path: Path
) -> None:
    root = kitti_named(kitti, "07", tmp_path / "kitti")
    config = config_of(test_data, kitti=root, quick=True)
    stored = study_descriptors(config, tmp_path / "out", 1, None).stored
    assert stored is not None
    assert stored.equal == stored.rows > 1000
    assert f"{stored.curve.recall_at_full_precision:.6f}" == "0.668122"
    assert max(stored.vectors.values()) < 1e-4


def test_a_difference_is_told_unless_every_figure_is_close() -> None:
    close = Difference("a", {"x": 100.0, "y": 10.0}, {"x": 104.0, "y": 9.6}, "{:.0f}", "r")
    off = Difference("b", {"x": 100.0, "y": 10.0}, {"x": 104.0, "y": 9.4}, "{:.1f}", "drive")
    assert close.met and not off.met
    ((label, cells),) = differences_table([close, off]).rows
    assert label == "b"
    assert [cell.text for cell in cells] == ["x 100.0; y 10.0", "x 104.0; y 9.4", "drive"]
    assert met_sentence([close, off]).endswith("in every case: a.")


def test_a_conclusion_counts_the_cases_in_which_it_holds() -> None:
    figures = {
        "odometry objects:author": {"x": 2.0, "y": 1.0},
        "odometry every_3rd": {"x": 1.0, "y": 2.0},
    }

    def value(case: str, name: str, operand: Operand) -> float | None:
        assert name in formats
        return figures.get(str(operand), {}).get(case)

    def last(*cases: str) -> Claim:
        return decide("views", cases, value, formats)[-1]

    formats = dict.fromkeys(_SHOWN, "{:.0f}")
    assert last("x", "y", "z").holds == {"x": True, "y": False}
    assert last("x", "y", "z").verdict == "holds in 1 of 2; not: y"
    assert last("x").verdict == "holds"
    assert last("y").verdict == "missed: y"
    assert last("z").verdict == Claim("c", {}, {}).verdict == "not measured"


def test_every_conclusion_has_two_sides() -> None:
    for part, known in (("views", _SHOWN), ("maps", {"": ""}), ("descriptors", CHAPTER4)):
        formats = dict.fromkeys(known, "{:.1f}")
        found = decide(part, ("x",), lambda case, name, operand: 1.0, formats)
        assert found and all(claim.holds.keys() == {"x"} for claim in found)
