# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The report opens offline, holds the figures of its evaluations, and is written whole."""

import csv
import json
from dataclasses import replace
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from descriptor_runs import camera_laps, descriptor_run, poses_at
from error_codes import has_code
from fusionslam.base.arrays import Points
from fusionslam.errors import ConfigError, DataError
from fusionslam.evaluation import (
    DescriptorRun,
    Evaluation,
    VerifiedRun,
    evaluate,
    evaluate_verified,
    published_figures,
)
from fusionslam.fusion import FusionConfig, fuse
from fusionslam.loop_closure import fusion_of_scans
from fusionslam.pipelines.recording import Recording
from fusionslam.pipelines.results import Work, verified_path
from fusionslam.registration import PreparedCloud, RegistrationConfig
from fusionslam.report import write_report
from fusionslam.report.loops.comparison import Compared, draw_costs
from fusionslam.report.loops.frame_pairs import ScanReader, draw_overlay
from fusionslam.report.loops.outcomes import judge_queries, telling_loops, telling_pairs
from fusionslam.report.loops.plots import draw_curves
from fusionslam.report.loops.stored import write_stored_report
from fusionslam.report.loops.tables import summary_table
from fusionslam.report.page.figures import widest_axes
from fusionslam.sensors.frame import Cloud
from pages import Page, read_page
from rows import rows
from verified import verified_run

pytestmark = pytest.mark.usefixtures("unrendered")


def some_run(
    source: str = "lidar", descriptor: str = "m2dp", count: int = 120, noise: float = 8, **more: Any
) -> DescriptorRun:
    rng = np.random.default_rng(int(noise * 10))
    poses = camera_laps(count)
    descriptors = (poses[:, :3, 3] + rng.normal(0, noise, (count, 3))).astype(np.float32)
    # Something stood before the sensor: revisits that no sensible threshold accepts.
    descriptors[-6:] += rng.normal(0, 2000, (min(count, 6), 3)).astype(np.float32)
    fields: dict[str, Any] = {
        "source": source,
        "descriptor": descriptor,
        "frames": 10 * np.arange(count),
        "stamps_ns": 1_700_000_000_000_000_001 + np.arange(count) * 10**8,
        "poses": poses,
    }
    return descriptor_run(descriptors, **(fields | more))


def some_cloud(source: str, frame: int) -> Cloud:
    rng = np.random.default_rng(frame)
    points = (rng.normal(0, 1, (300, 3)) * (20, 10, 1)).astype(np.float32)
    colors = rng.integers(0, 255, (300, 3)).astype(np.uint8)
    return Cloud(points, colors if source == "lidar" else None)


def some_image(source: str, frame: int) -> NDArray[np.uint8]:
    return np.full((30, 100, 3), frame % 255, dtype=np.uint8)


Evaluations = list[Evaluation]
Written = tuple[Path, Page]


def read_matches(folder: Path) -> list[dict[str, str]]:
    return list(csv.DictReader((folder / "matches.csv").open()))


def report(evaluations: Evaluations, folder: Path, **change: Any) -> Page:
    fixed: dict[str, Any] = {
        "dataset_name": "KITTI 06",
        "command": "fusionslam bench <KITTI> -d m2dp",
        "config": {"evaluation": {"radius": 10.0}},
    }
    return read_page(write_report(evaluations, folder, **(fixed | change)))


@pytest.fixture(scope="module")
def evaluations() -> Evaluations:
    runs = [some_run(), some_run(descriptor="cm2dp", noise=3), some_run("stereo", noise=15)]
    known = [published_figures("06", run.source, run.descriptor, 1101) for run in runs]
    return [
        replace(evaluate(run, window=20), published=figures)
        for run, figures in zip(runs, known, strict=True)
    ]


@pytest.fixture(scope="module")
def written(evaluations: Evaluations, tmp_path_factory: pytest.TempPathFactory) -> Written:
    folder = tmp_path_factory.mktemp("report") / "new" / "folder"
    return folder, report(evaluations, folder, clouds=some_cloud, images=some_image)


def test_the_page_holds_the_figures(written: Written, evaluations: Evaluations) -> None:
    page = written[1]
    for evaluation in evaluations:
        curve = evaluation.curves["revisit"]
        for name in ("recall_at_full_precision", "max_f1", "average_precision", "top1"):
            assert f"{getattr(curve, name):.3f}" in page.text
        assert curve.explain(curve.max_f1_threshold) in page.text
    assert "0.668" in page.text and "Perdomo 2019" in page.text
    assert "radius 10 m" in page.text and "window 20 frames" in page.text
    assert "fusionslam bench <KITTI> -d m2dp" in page.text
    assert "<script" not in (written[0] / "report.html").read_text("utf-8")


def test_pictures_lie_beside_the_page_and_decode(written: Written) -> None:
    image = pytest.importorskip("PIL.Image")
    names = {path.name for path in written[0].iterdir() if path.suffix in (".png", ".jpg")}
    runs = ("lidar_m2dp", "lidar_cm2dp", "stereo_m2dp")
    expected = {"accuracy_cost.png", "pr_lidar.png", "pr_stereo.png"}
    expected |= {f"{kind}_{run}.png" for kind in ("trajectory", "distances") for run in runs}
    expected |= {f"pairs_{run}_{kind}.jpg" for run in runs for kind in ("best", "worst", "missed")}
    assert names == expected
    for name in ("accuracy_cost", "pr_lidar", "pr_stereo"):  # for papers
        starts = [(written[0] / f"{name}.{kind}").read_bytes()[:4] for kind in ("svg", "pdf")]
        assert starts == [b"<?xm", b"%PDF"]
    for name in names:
        with image.open(written[0] / name) as picture:
            picture.load()
            assert picture.format == {"p": "PNG", "j": "JPEG"}[name[-3]] and min(picture.size) > 200
    assert len(written[1].addresses) == len(names)


def test_names_of_descriptors_alike_in_cost_and_accuracy_do_not_overlap() -> None:
    text = pytest.importorskip("matplotlib.text").Text
    alike = evaluate(some_run(count=60), window=20)
    names = [f"descriptor_{number}" for number in range(12)]
    compared = [Compared(replace(alike, run=replace(alike.run, descriptor=n))) for n in names]
    figure = draw_costs([compared], "revisit")
    assert figure is not None
    for axis in figure.axes:
        extents = [text.get_window_extent(each) for each in axis.texts]
        assert len(extents) == len(names)
        assert not any(one.overlaps(other) for one, other in combinations(extents, 2))


def test_the_metrics_are_those_of_the_curves(written: Written, evaluations: Evaluations) -> None:
    metrics = json.loads((written[0] / "metrics.json").read_text())
    for run, evaluation in zip(metrics["runs"], evaluations, strict=True):
        assert run["source"] == evaluation.run.source
        assert run["descriptor"] == evaluation.run.descriptor
        for name, curve in evaluation.curves.items():
            assert run["protocols"][name] == curve.metrics()
            assert run["protocols"][name]["radius"] == 10
    assert metrics["versions"].keys() >= {"fusionslam", "numpy", "python", "system"}
    assert metrics["machine"]["cores"] >= 1


def test_every_match_is_a_row_of_loops_csv(written: Written, evaluations: Evaluations) -> None:
    rows = read_matches(written[0])
    assert len(rows) == 3 * (120 - 21)
    curve = evaluations[0].curves["revisit"]
    first = rows[0]
    assert (int(first["query"]), int(first["match"])) == (210, 10 * int(curve.matches[21]))
    assert int(first["query_stamp_ns"]) == 1_700_000_000_000_000_001 + 21 * 10**8
    own = [row for row in rows if (row["source"], row["descriptor"]) == ("lidar", "m2dp")]
    found = judge_queries(evaluations[0].run, curve)
    assert sum(int(row["accepted"]) for row in own) == found.accepted.sum()
    assert all((float(row["metres"]) < 10) == (row["correct"] == "1") for row in rows)


def test_poses_are_tum_lines_with_whole_nanoseconds(written: Written) -> None:
    assert not [path for path in written[0].iterdir() if path.name.startswith(".")]
    lines = (written[0] / "poses_tum.txt").read_text().splitlines()
    assert len(lines) == 120
    assert lines[0].split() == ["1700000000.000000001", "0", "0", "40", "0", "0", "0", "1"]


@rows("count", [1, 5, 40])
def test_a_sequence_without_revisits_is_reported(tmp_path: Path, count: int) -> None:
    poses = poses_at(np.arange(count)[:, None] * (100.0, 0, 0))
    evaluation = evaluate(some_run(count=count, poses=poses), window=3)
    curve = evaluation.curves["revisit"]
    assert curve.explain(None) in report([evaluation], tmp_path).text
    assert not list(tmp_path.glob("trajectory_*")) and not list(tmp_path.glob("distances_*"))
    assert "NaN" not in (tmp_path / "metrics.json").read_text()


def test_without_ground_truth_there_are_loops_but_no_accuracy(tmp_path: Path) -> None:
    run = some_run(poses=None, dataset="walk")
    page = report([evaluate(run, window=20)], tmp_path, dataset_name="walk")
    assert "R@100P" not in page.text
    rows = read_matches(tmp_path)
    assert len(rows) == 99 and {row["correct"] for row in rows} == {""}
    assert {path.name for path in tmp_path.glob("*.png")} == {"distances_lidar_m2dp.png"}
    assert not (tmp_path / "poses_tum.txt").exists()


def test_frames_that_cannot_be_read_are_left_out(tmp_path: Path) -> None:
    def broken(source: str, frame: int) -> Cloud:
        raise DataError(f"cannot read {source} {frame}")

    report([evaluate(some_run(), window=20)], tmp_path / "none", clouds=broken)
    assert not list((tmp_path / "none").glob("pairs_*"))
    report([evaluate(some_run(), window=20)], tmp_path / "images", clouds=broken, images=some_image)
    assert len(list((tmp_path / "images").glob("pairs_*"))) == 3


def test_what_was_not_evaluated_cannot_be_reported(tmp_path: Path) -> None:
    evaluation = evaluate(some_run(), window=20, protocols=["revisit"])
    with pytest.raises(ConfigError, check=has_code("not-judged", "perdomo2019")):
        report([evaluation], tmp_path, protocol="perdomo2019")
    with pytest.raises(ConfigError, check=has_code("unknown-protocol")):
        report([evaluation], tmp_path, protocol="revisits")
    with pytest.raises(DataError, check=has_code("no-runs")):
        report([], tmp_path)
    with pytest.raises(ConfigError, check=has_code("needs-poses", "evaluation.protocol")):
        report(beside_descriptors()[:1], tmp_path, protocol="pose-1m-5deg")


def test_loops_are_judged_by_the_protocol_stored_in_the_folder(tmp_path: Path) -> None:
    stored = {"lidar": {"evaluation": {"protocol": "perdomo2019"}}}
    Work(Recording(str(tmp_path / "gone")), "KITTI 06", configs=stored).save(tmp_path)
    evaluations = [evaluate(some_run(config={"fusion": {}}), window=20)]
    for protocol, judged_by in ((None, "perdomo2019"), ("revisit", "revisit")):
        path = write_stored_report(tmp_path, evaluations, protocol=protocol)
        assert f"protocol {judged_by}" in read_page(path).text


def test_the_pairs_tell_the_best_the_worst_and_the_missed(evaluations: Evaluations) -> None:
    run, curve = evaluations[0].run, evaluations[0].curves["revisit"]
    pairs = {pair.kind: pair for pair in telling_pairs(run, curve)}
    matched = curve.matches >= 0
    assert pairs["best"].distance == pytest.approx(curve.distances[curve.correct].min(), rel=1e-5)
    false = curve.distances[matched & ~curve.correct]
    assert pairs["worst"].distance == pytest.approx(false.min(), rel=1e-5)
    assert pairs["worst"].metres >= 10
    assert pairs["missed"].metres < 10 and judge_queries(run, curve).missed[pairs["missed"].query]


def beside_descriptors() -> list[Evaluation]:
    """Verified loops, and a descriptor of the same frames that finds its first match wrong."""
    verified = evaluate_verified(verified_run(), window=0)
    run = verified.run
    names = ("dataset", "poses", "frames", "numbers", "stamps_ns")
    plain = some_run(count=len(run), **{name: getattr(run, name) for name in names})
    return [evaluate(plain, window=0), verified]


def test_verified_loops_are_a_row_beside_descriptors(tmp_path: Path) -> None:
    page = report(beside_descriptors(), tmp_path, clouds=some_cloud, protocol="pose-2m-5deg")
    assert "verified m2dp+scan_context" in page.text and "3 loops accepted" in page.text
    names = {path.stem for path in tmp_path.iterdir() if path.suffix in (".png", ".jpg")}
    run = "lidar_verified_m2dp-scan_context"
    kinds = ("best", "worst", "missed")
    drawn = {"pr_lidar", f"trajectory_{run}", *(f"pairs_{run}_{kind}" for kind in kinds)}
    assert drawn <= names and f"distances_{run}" not in names
    plain, verified = json.loads((tmp_path / "metrics.json").read_text())["runs"]
    assert not plain["verified"] and "pose-2m-5deg" not in plain["protocols"]
    assert verified["verified"] and verified["costs"]["bytes_per_descriptor"] is None
    assert verified["protocols"]["pose-2m-5deg"]["recall_at_full_precision"] == 0.5
    assert verified["accepted"]["pose-1m-5deg"] == {"loops": 3, "wrong": 1, "recall": 0.25}
    assert verified["by_direction"]["pose-2m-5deg"]["opposite"]["top1"] == 1


def test_verified_loops_are_rows_of_matches_with_the_errors_of_their_poses(tmp_path: Path) -> None:
    report(beside_descriptors(), tmp_path, protocol="pose-2m-5deg")
    rows = read_matches(tmp_path)
    own = {int(row["query"]): row for row in rows if row["descriptor"].startswith("verified")}
    assert sorted(own) == [40, 50, 60, 70, 80]
    assert {query for query, row in own.items() if row["accepted"] == "1"} == {40, 50, 80}
    assert {query for query, row in own.items() if row["correct"] == "1"} == {40, 50, 70, 80}
    assert float(own[50]["pose_error_m"]) == pytest.approx(1.5, abs=1e-3)
    assert float(own[60]["pose_error_deg"]) == pytest.approx(5.2, abs=1e-3)
    shown = [own[40][name] for name in ("probability", "overlap", "distance")]
    assert shown == ["0.9", "0.75", "0.1"]
    assert own[50]["distance"] == ""  # only the other descriptor found it
    other = next(row for row in rows if row["descriptor"] == "m2dp")
    assert {other[name] for name in ("probability", "overlap", "pose_error_m")} == {""}
    report([evaluate_verified(verified_run(poses=None), window=0)], tmp_path)
    rows = read_matches(tmp_path)
    assert [row["accepted"] for row in rows] == ["1", "1", "0", "0", "1"]
    assert {row["correct"] + row["pose_error_m"] for row in rows} == {""}


def test_telling_loops_are_shown_before_and_after_registration() -> None:
    run = verified_run()
    curve = evaluate_verified(run, radius=10, window=0).curves["revisit"]
    assert telling_loops(run, None) == {8: "probable", 5: "improbable", 4: "opposite"}
    assert telling_loops(run, curve) == {8: "wrong", 5: "improbable", 4: "opposite"}
    none = replace(run, accepted=np.zeros(len(run), np.bool_))
    assert telling_loops(none, curve) == {}
    corner = np.array([[x, 0, z] for x in range(9) for z in range(3)], np.float32)
    corner = np.concatenate([corner, [[0, y, 1] for y in range(1, 6)]]).astype(np.float32)
    pose = run.match_from_query[4]
    later = ((corner - pose[:3, 3]) @ pose[:3, :3]).astype(np.float32)  # R^T (p - t)
    scans = {20: corner, 40: later}
    figure = draw_overlay(run, 4, lambda source, frame: scans[frame])
    before, after = ([c.get_offsets() for c in axis.collections] for axis in figure.axes)
    assert np.allclose(before[0], corner[:, :2]) and np.allclose(before[1], later[:, :2])
    assert np.allclose(after[0], corner[:, :2]) and np.allclose(after[1], corner[:, :2], atol=1e-5)
    assert draw_overlay(run, 4, lambda source, frame: None) is None
    assert draw_overlay(run, 4, lambda source, frame: corner[:0]) is None


@rows("extent", [(9, 1), (1.2, 1), (1, 1), (1, 1.2), (1, 9)])
def test_titles_of_registered_clouds_lie_within_the_picture(extent: tuple[float, float]) -> None:
    run = verified_run()
    points = np.random.default_rng(0).uniform(-9, 9, (200, 3)) * (*extent, 0.01)
    figure = draw_overlay(run, 4, lambda *_: points.astype(np.float32))
    figure.canvas.draw()
    for axis in figure.axes:
        (left, low), (right, high) = axis.title.get_window_extent().get_points()
        assert 0 <= left < right <= figure.bbox.width and 0 <= low < high <= figure.bbox.height


def test_more_curves_than_colours_are_told_apart_and_paths_lie_in_their_widest_plane() -> None:
    assert widest_axes(camera_laps(50)[:, :3, 3]) == (0, 2)
    assert widest_axes(np.zeros((1, 3))) == (0, 1)
    curve = evaluate_verified(verified_run(), radius=10, window=0).curves["revisit"]
    figure = draw_curves({f"descriptor {number}": curve for number in range(20)})
    handles, _ = figure.axes[0].get_legend_handles_labels()
    assert len({(line.get_color(), line.get_linestyle()) for line in handles}) == 20


def test_the_summary_names_verified_loops_in_short_where_that_tells_them_apart() -> None:
    runs = [verified_run(), verified_run(source="cloud")]
    judged = [evaluate_verified(run, radius=10, window=0) for run in runs]
    table = summary_table(judged, "revisit")
    names = ["LiDAR-camera, verified", "LiDAR, full circle, verified"]
    assert [label for label, _ in table.rows] == names
    assert "match" not in [name for name, _ in table.heads]  # a row fits the page
    twice = [*judged, evaluate_verified(verified_run(descriptors=("cm2dp",)), radius=10, window=0)]
    labels = [label for label, _ in summary_table(twice, "revisit").rows]
    assert labels[0] == "LiDAR-camera, verified m2dp+scan_context"
    assert labels[2] == "LiDAR-camera, verified cm2dp"


def test_the_page_shows_registered_clouds_and_the_reasons_of_the_others(tmp_path: Path) -> None:
    run, rng = verified_run(), np.random.default_rng(0)
    points = rng.uniform(-9, 9, (200, 3)).astype(np.float32)
    words = {"dataset_name": "nine", "command": "", "config": {}, "scans": lambda *_: points}
    page = write_report([evaluate_verified(run, radius=10, window=0)], tmp_path, **words)
    shown = sorted(path.name for path in tmp_path.glob("registered_*.jpg"))
    assert [name.rsplit("_", 1)[1] for name in shown] == ["40.jpg", "50.jpg", "80.jpg"]
    text = page.read_text()
    assert all(code in text for code in ("low-overlap", "tilted", "170"))


def test_a_folder_of_verified_loops_alone_has_a_page(tmp_path: Path) -> None:
    config = {"fusion": {}, "loop_closure": {"window": 1}}  # that of evaluation is 50
    run = verified_run(poses=None, body_from_cloud=None, config=config)
    path = verified_path(tmp_path, "lidar", "m2dp")
    path.parent.mkdir()
    run.save(path)
    Work(Recording(str(tmp_path / "gone")), run.dataset).save(tmp_path)
    text = write_stored_report(tmp_path).read_text()
    assert "3 loops accepted" in text and "low-overlap" in text


def test_the_shown_clouds_are_those_that_registration_compared(
    recording: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("fusionslam.registration.scale.ROOM_REACH", np.inf)  # fits what is no room
    shown: dict[float, list[Points]] = {}

    def note(run: VerifiedRun, query: int, scans: ScanReader) -> None:
        shown.setdefault(run.config["registration"]["voxel"], []).append(scans(run.source, 0))

    monkeypatch.setattr("fusionslam.report.loops.page.draw_overlay", note)
    for voxel in (0.4, 2.0):
        config = {"fusion": {"source": "lidar"}, "registration": {"voxel": voxel}}
        folder = tmp_path / str(voxel)
        Work(Recording(str(recording)), "nine frames").save(folder)
        judged = evaluate_verified(verified_run(config=config), radius=10, window=0)
        write_stored_report(folder, [judged])
    (frame,) = Recording(str(recording)).open("lidar").only([0])
    for voxel, drawn in shown.items():
        config = RegistrationConfig(voxel=voxel)
        scan = fuse(frame, fusion_of_scans(FusionConfig(), config))
        expected = PreparedCloud(scan, config).above_ground
        assert len(expected) and all(np.array_equal(each, expected) for each in drawn)
    assert len(shown[0.4][0]) > len(shown[2.0][0])


def test_a_scan_that_is_empty_is_no_failure(
    recording: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn: list[Points | None] = []

    def note(run: VerifiedRun, query: int, scans: ScanReader) -> None:
        drawn.append(scans(run.source, 0))

    empty = Cloud(np.empty((0, 3), np.float32))
    monkeypatch.setattr("fusionslam.report.loops.stored.fuse", lambda *_: empty)
    monkeypatch.setattr("fusionslam.report.loops.page.draw_overlay", note)
    Work(Recording(str(recording)), "nine frames").save(tmp_path / "out")
    write_stored_report(tmp_path / "out", [evaluate_verified(verified_run(), radius=10, window=0)])
    assert drawn and all(scan is not None and not len(scan) for scan in drawn)
