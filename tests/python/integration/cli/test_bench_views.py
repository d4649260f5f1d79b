# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Ways to recognise views side by side, on small recordings."""

import json
import shutil
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from artefacts import artefact
from cli import fails, succeeds
from error_codes import has_code
from fusionslam.cli.bench import default_data
from fusionslam.errors import ConfigError, DataError
from fusionslam.evaluation import judge_views, published_views, rerun_views
from fusionslam.geometry.odometry_noise import DRIFT, OdometryConfig, add_odometry_errors
from fusionslam.pipelines import methods
from fusionslam.pipelines.compare_views import bench_views
from fusionslam.pipelines.drives import Drive, move_clouds, open_drive, places_at
from fusionslam.pipelines.methods import METHODS, Task, latest, run_templates
from fusionslam.report.views.comparison_tables import accuracy_table, as_json, cost_table, markdown
from fusionslam.sensors.image_series import ImageSeries
from fusionslam.views.visual_templates import VisualTemplates, VisualTemplatesConfig
from recordings import PLACES, write_drive
from rows import rows

SMALL = VisualTemplatesConfig(columns=12, rows=4, bottom=None, shift=2)
QUICK = ("objects:author", "visual_templates", "always_new", "every_3rd")


def write_warehouse(folder: Path) -> None:
    (folder / "recordings").mkdir()
    write_drive(folder / "recordings/warehouse.npz", empty=3)


@pytest.fixture(scope="module")
def path() -> Path:
    return artefact("cli-warehouse", write_warehouse) / "recordings/warehouse.npz"


@pytest.fixture(scope="module")
def drive(path: Path) -> Drive:
    return open_drive(path)


class Pictured(Drive):
    """A drive with other images."""

    def __init__(self, drive: Drive, images: ImageSeries) -> None:
        self.__dict__.update(drive.__dict__)
        self._found = images

    def images_with_poses(self, bottom: int | None = None) -> ImageSeries:
        return self._found


def images_of(drive: Drive, per_scan: int = 5) -> ImageSeries:
    """A few images a scan; all of one place are alike, and places differ."""
    ends = drive.scenes.seconds
    seconds = np.arange(0, ends[-1] + 0.1, 2.0 / per_scan)
    places = (np.floor(seconds / 2.0) % PLACES).astype(int)
    shades = np.random.default_rng(3).integers(0, 256, (PLACES, 24, 48)).astype(np.uint8)
    poses = places_at(seconds, ends, drive.scenes.poses)
    return ImageSeries(seconds, poses, lambda i: shades[places[i]], "nowhere")


def test_a_drive_leaves_out_the_scans_that_see_the_floor_only(drive: Drive) -> None:
    assert (len(drive.scenes), drive.dropped) == (2 * PLACES, 3)
    assert (drive.name, drive.world, drive.shapes) == ("warehouse", "warehouse", "collision")
    assert drive.with_ground is not None
    assert drive.with_ground.numbers.tolist() == drive.scenes.numbers.tolist()


def test_every_figure_is_what_the_judge_says_of_the_ids(drive: Drive) -> None:
    results = bench_views([drive], ("objects:author", "cm2dp", "every_3rd"))
    poses, seconds = drive.scenes.poses, drive.scenes.seconds
    table = {label: cells for label, cells in accuracy_table(results).rows}
    for result in results:
        assert result.run is not None
        for rule in ("paper", "author"):
            expected = judge_views(result.run.ids, poses, seconds, rule=rule)
            assert getattr(result, rule).metrics() == expected.metrics()
        shown = [cell.text for cell in table[result.title]]
        report = result.paper
        assert report is not None and report.accuracy is not None
        assert shown[0] == f"{100 * report.accuracy:.1f}"
        assert as_json(result)["paper"] == report.metrics()
    # Costs have those of the thesis beside them.
    label, cells = cost_table(results[:1]).rows[0]
    texts = [cell.text for cell in cells]
    assert label == "first stage" and texts[0].isdigit()
    assert (texts[1], texts[3]) == ("194", "78")
    seen_again = results[0].paper
    assert seen_again is not None and seen_again.revisits == PLACES
    assert seen_again.loop_recall is not None and seen_again.loop_recall > 0.9


def test_published_figures_stand_in_their_rows(drive: Drive, path: Path, tmp_path: Path) -> None:
    results = bench_views([drive], QUICK, frames=["robot", "drift"])
    by_row = {(r.method, r.frame): r for r in results}
    known = {f.method: f for f in published_views("warehouse")}
    again = {f.input: f for f in rerun_views("warehouse")}
    first = by_row["objects:author", "robot"]
    assert first.published == known["first stage"]
    assert first.rerun == again["first stage, robot's frame"]
    drifting = by_row["objects:author", "drift"]
    assert drifting.rerun == again["first stage, world coordinates, drifting odometry"]
    assert by_row["visual_templates", "robot"].published == known["RatSLAM"]
    assert by_row["always_new", "robot"].published is None
    assert by_row["every_3rd", "robot"].rerun == again["no sensor: new every 3rd"]
    shutil.copy(path, tmp_path / "cellar.npz")
    (elsewhere,) = bench_views([open_drive(tmp_path / "cellar.npz")], ["objects:author"])
    assert elsewhere.published is None and elsewhere.rerun is None


def test_the_registry_is_listed_and_its_names_are_among_the_published_ones() -> None:
    listed = succeeds("bench", "views", "--methods", "list").stdout.split()
    assert METHODS.keys() <= {*listed}
    methods = {figures.method for figures in published_views("warehouse")}
    inputs = {figures.input for figures in rerun_views("warehouse")}
    for method in METHODS.values():
        assert method.published is None or method.published in methods
        assert set(method.rerun.values()) <= inputs


def test_a_drive_without_images_says_so_and_costs_no_other_row(drive: Drive) -> None:
    results = bench_views([drive], QUICK)
    notes = {result.method: result.note for result in results}
    assert notes == {**dict.fromkeys(QUICK, ""), "visual_templates": "no images"}
    assert "warehouse: templates: no images" in markdown(results, {"warehouse": 3})


def test_templates_are_fed_with_all_images_and_asked_at_the_scans(drive: Drive) -> None:
    images = images_of(drive)
    pictured = Pictured(drive, images)
    found = run_templates(SMALL)(Task("templates", pictured, "robot"))
    ids = ids_of(images)
    at = [max(np.flatnonzero(images.seconds <= t + 1e-6)) for t in drive.scenes.seconds]
    assert found.ids.tolist() == [ids[row] for row in at]
    assert found.method == "templates"
    assert found.bytes_per_view == VisualTemplates(SMALL).bytes_per_view
    assert found.judge().loop_recall == 1.0
    # They can be judged at every image, too.
    found = run_templates(SMALL, every_image=True)(Task("templates", pictured, "robot"))
    assert found.method == "templates, 2.5 Hz"
    assert found.ids.tolist() == ids_of(images)
    assert np.array_equal(found.poses, images.poses)
    assert np.array_equal(found.stamps, images.seconds)
    unplaced = Pictured(drive, replace(images, poses=None))
    with pytest.raises(DataError, check=lambda error: error.code == "no-poses"):
        run_templates(SMALL, every_image=True)(Task("templates", unplaced, "robot"))


def ids_of(images: ImageSeries) -> list[int]:
    alone = VisualTemplates(SMALL)
    return [alone.process(images.image(row)).id for row in range(len(images))]


def test_the_latest_is_the_one_of_the_same_instant_or_the_first() -> None:
    times = np.array([1.0, 1.1, 1.2])
    asked = np.array([0.5, 1.0, 1.1 - 1e-9, 1.15, 9.0])
    assert latest(times, asked).tolist() == [0, 0, 1, 1, 2]


def test_clouds_of_one_place_meet_in_the_frame_of_odometry(drive: Drive) -> None:
    assert move_clouds(drive.scenes, "robot") is drive.scenes
    scenes = move_clouds(drive.scenes, "odometry")
    assert scenes.clouds is not None and drive.scenes.clouds is not None
    assert scenes.frame == "odometry"
    for row in (0, 5, 17):
        points = drive.scenes.clouds[row].points
        x, y, _ = drive.scenes.true_poses()[row]
        assert np.allclose(scenes.clouds[row].points, points + np.array([x, y, 0]), atol=1e-5)


def test_drift_takes_clouds_where_odometry_believes_to_be(drive: Drive) -> None:
    turned = replace(drive.scenes, poses=drive.scenes.true_poses() + np.array([0, 0, np.pi / 2]))
    scenes = move_clouds(turned, "drift")
    places = add_odometry_errors(turned.true_poses(), turned.seconds, DRIFT)
    assert not np.allclose(
        places, add_odometry_errors(turned.poses, turned.seconds, OdometryConfig())
    )
    assert scenes.clouds is not None and turned.clouds is not None
    points = turned.clouds[9].points
    x, y, yaw = places[9]
    assert yaw == pytest.approx(np.pi / 2, abs=0.1)
    expected = np.stack([x - points[:, 1], y + points[:, 0], points[:, 2]], axis=1)
    assert np.allclose(scenes.clouds[9].points, expected, atol=0.05)


def test_what_no_frame_changes_is_run_once(drive: Drive, monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[str] = []

    def counted(task: Task) -> Any:
        calls.append(task.frame)
        return methods.run_baseline("always new")(task)

    changed = replace(METHODS["always_new"], run=counted)
    monkeypatch.setitem(METHODS, "always_new", changed)
    results = bench_views([drive], ["always_new"], frames=["robot", "odometry", "drift"])
    assert calls == ["robot"]
    assert [result.frame for result in results] == ["robot", "odometry", "drift"]


def test_unknown_names_and_two_drives_of_one_name_are_refused(drive: Drive) -> None:
    with pytest.raises(ConfigError, match=r"method .*'nobody'"):
        bench_views([drive], ["nobody"])
    with pytest.raises(ConfigError, match=r"frame .*'x'"):
        bench_views([drive], frames=["x"])
    with pytest.raises(DataError, check=lambda error: error.fields == ("warehouse",)):
        bench_views([drive, drive], ["always_new"])


def test_unfit_recordings_are_refused(path: Path, drive: Drive, tmp_path: Path) -> None:
    with np.load(path) as whole:
        arrays = {name: whole[name] for name in whole.files if name != "poses"}
    np.savez(tmp_path / "lost.npz", **arrays)
    write_drive(tmp_path / "bare.npz", laps=0, empty=4)
    move_clouds(drive.scenes, "odometry").save(tmp_path / "moved.npz")
    for name, code in (("lost", "no-poses"), ("bare", "only-floor"), ("moved", "wrong-frame")):
        with pytest.raises(DataError, check=has_code(code)):
            open_drive(tmp_path / f"{name}.npz").scenes  # noqa: B018
    (tmp_path / "cut.npz").write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    with pytest.raises(DataError, match=r"cut\.npz"):
        open_drive(tmp_path / "cut.npz")


def test_a_saved_scene_set_is_a_drive(drive: Drive, tmp_path: Path) -> None:
    drive.scenes.save(tmp_path / "scenes.npz")
    again = open_drive(tmp_path / "scenes.npz")
    one, other = (bench_views([d], ["objects:author"])[0].run for d in (drive, again))
    assert one is not None and other is not None
    assert one.ids.tolist() == other.ids.tolist()
    assert again.with_ground is None


def test_without_data_the_recordings_of_the_test_data_are_taken(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("FUSIONSLAM_TEST_DATA", str(path.parent.parent))
    assert default_data() == [str(path)]
    monkeypatch.delenv("FUSIONSLAM_TEST_DATA")
    assert default_data() == ["warehouse", "house", "hospital"]


def test_the_command_prints_narrow_tables_and_writes_all_figures(
    path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "out"
    result = succeeds("bench", "views", path, "-o", out, "-m", ",".join(QUICK))
    assert max(map(len, result.stdout.splitlines()[:-2])) <= 80
    assert "first stage" in result.stdout and "warehouse: 3 scans" in result.stdout
    content = json.loads((out / "views_bench.json").read_text())
    # What scores without a sensor stands in every table.
    assert [row["method"] for row in content["results"]] == [*QUICK, "every_2nd"]
    assert content["scans_left_out"] == {"warehouse": 3}
    assert "| first stage |" in (out / "views.md").read_text()
    assert (out / "views.html").is_file()


@pytest.mark.slow
def test_several_frames_have_a_page_each(path: Path, tmp_path: Path) -> None:
    words = ("bench", "views", path, "-o", tmp_path, "-m", "objects:author", "--frame", "all")
    result = succeeds(*words)
    assert "every 3rd" in result.stdout
    for frame in ("robot", "odometry", "drift"):
        assert f"warehouse, {frame}: 24 scans" in result.stdout
        assert (tmp_path / frame / "views.html").is_file()


@rows(
    "words, code, named",
    [
        (("nowhere.npz",), 1, "nowhere.npz"),
        (("warehose",), 1, "'warehouse'"),
        (("PATH", "-m", "object"), 2, "'objects'"),
        (("PATH", "--frame", "world"), 2, "--frame"),
        (("PATH", "--shapes", "round"), 2, "--shapes"),
    ],
)
def test_a_mistake_is_named_in_a_line(
    path: Path, words: tuple[str, ...], code: int, named: str, tmp_path: Path
) -> None:
    words = tuple(str(path) if word == "PATH" else word for word in words)
    assert named in fails(code, "bench", "views", *words, "-o", tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_second_stage_costs_bytes_and_only_rejects(
    drive: Drive, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("onnxruntime")
    first, both = bench_views([drive], ["objects:author", "two_stages:author"])
    assert first.run is not None and both.run is not None
    assert first.run.bytes_per_view is not None and both.run.bytes_per_view is not None
    assert both.run.bytes_per_view > first.run.bytes_per_view + 1000
    # Up to its first rejection it gives the same ids.
    same = first.run.ids == both.run.ids
    rejected = int(np.argmin(same)) if not same.all() else len(same)
    assert rejected == len(same) or both.run.ids[rejected] > first.run.ids[rejected]
    # Without its package, its row says so.
    monkeypatch.setitem(sys.modules, "onnxruntime", None)
    first, both = bench_views([drive], ["objects:author", "two_stages:author"])
    assert first.run is not None
    assert both.run is None and "pip install 'fusionslam[onnx]'" in both.note
