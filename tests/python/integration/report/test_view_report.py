# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The report of views opens offline, has the baselines, and can be written again from its files."""

import csv
import io
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from cli import last_line, succeeds
from error_codes import has_code
from fusionslam.errors import ConfigError, DataError, ShapeError
from fusionslam.evaluation import ViewJudge, ViewRun, baselines, every_kth, sweep_views
from fusionslam.report import (
    has_view_runs,
    load_view_runs,
    write_stored_view_report,
    write_view_report,
)
from fusionslam.report.views.exports import loop_word, scrub_data, verdict
from fusionslam.report.views.plots import path_pieces
from fusionslam.report.views.previews import MOST, counterparts, load_previews, select_rows
from fusionslam.report.views.thumbnails import HEIGHT, cloud_preview, image_preview, scale_of
from fusionslam.sensors.frame import Cloud
from pages import Page, read_page
from rows import rows

image = pytest.importorskip("PIL.Image")
pytestmark = pytest.mark.usefixtures("unrendered")
Written = tuple[Path, Page]


def laps(count: int = 60) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Poses and stamps of a robot that goes round a circle of 2 m twice, 1 s a scan."""
    angle = np.linspace(0, 4 * np.pi, count, endpoint=False)
    poses = np.stack([2 * np.sin(angle), 2 * np.cos(angle), -angle], axis=1)
    return poses, np.arange(count, dtype=np.float64)


def ids_of_laps(count: int = 60) -> NDArray[np.int64]:
    """The second lap knows the first, but for two scans: one is wrong, one is new."""
    ids = np.arange(count) % (count // 2)
    ids[40], ids[45] = 3, 1000
    return ids


def some_cloud(number: int) -> Cloud:
    rng = np.random.default_rng(number)
    points = (rng.random((200, 3)) * (4, 4, 1) + (1, -2, 0)).astype(np.float32)
    return Cloud(points, rng.integers(0, 255, (200, 3)).astype(np.uint8))


def some_run(method: str = "ours", **change: Any) -> ViewRun:
    poses, stamps = laps()
    judge = ViewJudge(poses, stamps)
    fields: dict[str, Any] = {
        "world": "warehouse",
        "method": method,
        "ids": ids_of_laps(),
        "poses": poses,
        "stamps": stamps,
        "numbers": 2 * np.arange(60),
        "similarities": np.where(np.arange(60) > 0, 0.9, np.nan),
        "threshold": 0.5,
        "build_seconds": np.full(60, 2e-3),
        "match_seconds": np.full(60, 3e-5),
        "bytes_per_view": 92.5,
        "curve": sweep_views(judge, lambda t: every_kth(60, 1 + int(5 * t)), [0.1, 0.5, 0.9]),
        "config": {"preset": "robust"},
    }
    return ViewRun(**(fields | change))


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Written:
    folder = tmp_path_factory.mktemp("views") / "new"
    other = some_run("c-M2DP", ids=every_kth(60, 2), curve=None)
    path = write_view_report(
        [some_run(clouds=some_cloud), other], folder, command="bench <x>", notes=["A note."]
    )
    page = read_page(path)
    assert page.ids and "bench <x>" in page.text and "A note." in page.text
    return folder, page


def test_tables_have_baselines_and_loops_beside_accuracy(written: Written) -> None:
    text = (written[0] / "views.html").read_text("utf-8")
    tables = re.findall(r"<table>.*?</table>", text, flags=re.DOTALL)
    assert len(tables) == 4  # accuracy, costs, run again, thresholds
    for table in tables:
        assert all(f"no sensor: {name}" in table for name in baselines(1))
        if "accuracy" in table:
            assert "loop recall" in table
    assert "published: both stages" in tables[0] and "registering every pair" in tables[2]
    assert "(used" in tables[3]


def test_programs_without_a_sensor_that_were_compared_have_one_row_a_table(tmp_path: Path) -> None:
    measured = ("similarities", "threshold", "build_seconds", "match_seconds", "bytes_per_view")
    none: dict[str, Any] = {**dict.fromkeys(measured), "curve": None, "config": {}}
    compared = [some_run(f"no sensor: {n}", ids=every_kth(60, n), **none) for n in (1, 2, 3)]
    page = write_view_report([some_run(), *compared], tmp_path)
    tables = re.findall(r"<table>.*?</table>", page.read_text("utf-8"), flags=re.DOTALL)
    assert [table.count(">no sensor: ") for table in tables] == [3, 3, 3, 3]


def test_the_figures_are_those_of_the_judge(written: Written) -> None:
    report = some_run().judge()
    for value in (report.accuracy, report.loop_recall, report.loop_precision):
        assert f"{value:.1%}" in written[1].text
    metrics = json.loads((written[0] / "views.json").read_text())
    assert metrics["runs"][0]["loop_recall"] == report.loop_recall
    assert metrics["runs"][0]["baselines"]["always new"]["loop_recall"] == 0
    assert metrics["rule"] == "paper" and metrics["limits"]["loop_age"] == 20


def test_every_scan_is_a_row_and_every_false_positive_a_picture(written: Written) -> None:
    rows = list(csv.DictReader(io.StringIO((written[0] / "views.csv").read_text())))
    assert len(rows) == 120
    own = rows[40]
    assert (own["scan"], own["view_scan"], own["verdict"]) == ("80", "6", "false positive")
    assert (own["loop"], own["revisit"]) == ("wrong loop", "1")
    assert rows[45]["verdict"] == "false negative" and rows[0]["similarity"] == ""
    names = {path.name for path in written[0].iterdir() if path.suffix in (".png", ".jpg")}
    assert {f"views_{kind}_warehouse.png" for kind in ("pr", "errors", "times")} <= names
    assert {"views_path_warehouse_ours.png", "views_false_warehouse_ours_80.jpg"} <= names
    with image.open(written[0] / "views_false_warehouse_ours_80.jpg") as picture:
        picture.load()
        assert picture.height == HEIGHT and picture.width > 4 * HEIGHT


def test_the_same_page_is_written_from_the_stored_runs(
    written: Written, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.undo()  # pictures are rendered
    again = write_stored_view_report(written[0], tmp_path).read_text("utf-8")
    dated = re.compile(r"\d{4}-\d\d-\d\d \d\d:\d\d UTC")
    first = (written[0] / "views.html").read_text("utf-8")
    assert dated.sub("", again) == dated.sub("", first)


def test_the_command_report_writes_views_html(written: Written, tmp_path: Path) -> None:
    done = succeeds("report", written[0], "-o", tmp_path)
    assert last_line(done) == str(tmp_path / "views.html")
    assert (tmp_path / "views.html").stat().st_size > 10_000


def test_a_run_is_saved_whole_and_a_damaged_one_is_named(tmp_path: Path) -> None:
    run = some_run()
    run.save(tmp_path / "views" / "a.npz")
    again = ViewRun.load(tmp_path / "views" / "a.npz")
    for name in ("ids", "poses", "stamps", "numbers", "similarities", "match_seconds"):
        assert np.array_equal(getattr(again, name), getattr(run, name), equal_nan=True)
    assert (again.world, again.threshold, again.config) == ("warehouse", 0.5, {"preset": "robust"})
    assert again.curve.as_json() == run.curve.as_json()
    whole = (tmp_path / "views" / "a.npz").read_bytes()
    (tmp_path / "views" / "a.npz").write_bytes(whole[: len(whole) // 2])
    assert has_view_runs(tmp_path)
    with pytest.raises(DataError, match=r"a\.npz"):
        load_view_runs(tmp_path)


def test_without_revisits_and_false_positives_there_are_no_pictures(tmp_path: Path) -> None:
    poses = np.stack([np.arange(9.0), np.zeros(9), np.zeros(9)], axis=1)
    bare = ViewRun("hall", "ours", np.arange(9), poses, np.arange(9.0))
    page = read_page(write_view_report(bare, tmp_path))
    assert not [a for a in page.addresses if a.startswith("data:")]
    assert not list(tmp_path.glob("*.png"))
    assert "NaN" not in (tmp_path / "views.json").read_text()


def test_scans_that_cannot_be_read_have_no_picture_and_the_page_says_why(tmp_path: Path) -> None:
    def broken(number: int) -> Cloud:
        raise DataError(f"scan {number} is gone")

    page = read_page(write_view_report(some_run(clouds=broken), tmp_path))
    assert "scan 0 is gone" in page.text
    assert not list(tmp_path.glob("views_false_*"))


def test_an_image_is_shown_rather_than_the_cloud_or_an_older_picture(tmp_path: Path) -> None:
    def photo(number: int) -> NDArray[np.uint8]:
        return np.full((48, 64, 3), number, dtype=np.uint8)

    write_view_report(some_run(clouds=some_cloud), tmp_path)
    write_view_report(some_run(images=photo, clouds=some_cloud), tmp_path)
    previews = load_previews(tmp_path / "views" / "warehouse.previews")
    assert len(previews) == 60
    with image.open(io.BytesIO(previews[10 * 10**9])) as picture:
        assert picture.size == (HEIGHT * 64 // 48, HEIGHT)
        assert abs(picture.getpixel((50, 50))[0] - 20) < 4


@rows("colored", [True, False])
def test_a_red_post_ahead_is_seen_ahead_and_from_above(colored: bool) -> None:
    post = np.array([(2.0, y, z) for y in (-0.1, 0, 0.1) for z in np.linspace(0, 0.3, 20)])
    far = np.array([(6.0, y, z) for y in np.linspace(-3, 3, 60) for z in np.linspace(0, 1, 20)])
    points = np.concatenate([post, far]).astype(np.float32)
    colors = np.array([(255, 0, 0)] * len(post) + [(0, 0, 255)] * len(far), dtype=np.uint8)
    cloud = Cloud(points, colors if colored else None)
    data = cloud_preview(cloud, scale_of([cloud]))
    pixels = np.asarray(image.open(io.BytesIO(data)).convert("RGB")).astype(int)
    redness = pixels[..., 0] - pixels[..., 2] > (60 if colored else 25)
    rows, columns = np.nonzero(redness[:, :300])
    assert 140 < columns.mean() < 160 and rows.mean() > 80
    above = np.nonzero(redness[:, 304:])
    assert 72 < above[1].mean() < 88 and 80 < above[0].mean() < 125
    empty = Cloud(np.empty((0, 3), np.float32), np.empty((0, 3), np.uint8))
    for data in (cloud_preview(empty, scale_of([empty])), image_preview(np.zeros((9, 9), "u1"))):
        assert image.open(io.BytesIO(data)).height == HEIGHT


def test_a_false_negative_is_shown_beside_what_it_should_have_matched() -> None:
    run = some_run()
    report = run.judge()
    beside = counterparts(run, report)
    assert (verdict(report, 45), beside[45]) == ("false negative", 15)
    assert (loop_word(report, 45), beside[40], beside[0]) == ("missed revisit", 3, -1)
    frame = scrub_data(run, report, {})["frames"][45]
    assert scrub_data(run, report, {})["places"][frame["v"]]["n"] == 30


@rows("wrong", [2, 700])
def test_a_long_run_shows_at_most_so_many_scans_and_its_worst_false_positives(wrong: int) -> None:
    count = 2000
    poses = np.stack([0.1 * np.arange(count), np.zeros(count), np.zeros(count)], axis=1)
    ids = np.arange(count)
    ids[-wrong:] = 0
    report = ViewRun("w", "m", ids, poses, np.arange(count, dtype=np.float64)).judge()
    rows = select_rows(report)
    assert len(rows) <= MOST and {0, *range(count - min(wrong, MOST // 2), count)} <= set(rows)
    assert np.diff(rows).max() <= 10


def test_paths_are_cut_where_scans_are_missing_and_pairs_timed_by_stored_views() -> None:
    poses, stamps = laps()
    kept = np.r_[0:20, 40:60]
    run = ViewRun("w", "m", np.zeros(40, int), poses[kept], stamps[kept])
    assert [len(piece) for piece in path_pieces(run)] == [20, 20]
    run = ViewRun("w", "m", [0, 1, -1, 0], np.zeros((4, 3)), np.arange(4.0), match_seconds=[8] * 4)
    assert np.array_equal(run.pair_seconds, [np.nan, 8, 4, 4], equal_nan=True)


def test_runs_that_cannot_be_reported_are_refused(tmp_path: Path) -> None:
    for runs, code in (
        ([], "no-runs"),
        ([some_run(), some_run()], "same-name"),
        (ViewRun("w", "m", [], np.empty((0, 3)), []), "empty-run"),
    ):
        with pytest.raises(DataError, check=has_code(code)):
            write_view_report(runs, tmp_path)
    with pytest.raises(ConfigError, check=has_code("unknown-rule")):
        write_view_report(some_run(), tmp_path, rule="thesis")
    with pytest.raises(DataError, check=has_code("no-runs")):
        write_stored_view_report(tmp_path)
    with pytest.raises(ShapeError, match="build_seconds"):
        some_run(build_seconds=np.zeros(3))
