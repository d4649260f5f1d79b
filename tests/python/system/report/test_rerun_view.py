# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The live view, read back with rerun's own reader."""

import io
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from circling_robot import MS, START, circle
from error_codes import has_code
from fusionslam import ConfigError, DataError, FusionSlamError
from fusionslam.geometry.trajectory import Trajectory
from fusionslam.ratslam import Motion, RatSlam
from fusionslam.ratslam.events import Event, Look
from fusionslam.ratslam.slam import Step
from fusionslam.ratslam.view_sources import TemplateSource
from fusionslam.report.live.rerun_view import RerunView
from fusionslam.sensors.frame import Frame
from fusionslam.sensors.messages import Picture
from rows import rows

pytest.importorskip("rerun", reason="rerun is not installed")
chunks = pytest.importorskip("rerun.chunk", reason="this rerun has no reader for Python")


def true_circle() -> Trajectory:
    """The same way, elsewhere in the world, and known for its first two seconds only."""
    seconds = START / 1e9 + np.arange(61) * 0.033
    yaw = 1.0 + np.arange(61) * 0.033 * 2 * np.pi / 3
    radius = 0.5 / (2 * np.pi / 3)
    return Trajectory(seconds, 7 + radius * np.sin(yaw), -3 - radius * np.cos(yaw), yaw)


def record_view(path: Path, events: Any = None, **more: Any) -> tuple[RatSlam, list[Step]]:
    slam, steps = RatSlam(), []
    with RerunView(path, "circle", **more) as view:
        for event in circle() if events is None else events:
            steps.append(slam.step(event))
            view.step(steps[-1], slam, event)
    return slam, steps


TIMES = ("elapsed", "stamp")


def read_rows(path: Path) -> dict[str, list[tuple[int, int, dict[str, Any]]]]:
    """By entity: nanoseconds since the start, stamp, and the values of each row, in that order."""
    found: dict[str, Any] = {}
    for chunk in chunks.RrdReader(path).store().stream().to_chunks():
        batch = chunk.to_record_batch()
        assert not chunk.is_static and set(chunk.timeline_names) == {"elapsed", "stamp"}
        columns = {name.rpartition(":")[2]: batch.column(name) for name in batch.schema.names}
        elapsed, stamp = (columns.pop(name).cast("int64").to_pylist() for name in TIMES)
        columns.pop("rerun.controls.RowId")
        for row in range(batch.num_rows):
            values = {name: column[row].as_py() for name, column in columns.items()}
            found.setdefault(chunk.entity_path, []).append((elapsed[row], stamp[row], values))
    return {entity: sorted(of, key=lambda row: row[1]) for entity, of in found.items()}


def last(of: list[tuple[int, int, dict[str, Any]]], name: str) -> Any:
    return of[-1][2][name]


def test_everything_that_happened_is_in_the_file(tmp_path: Path) -> None:
    _, steps = record_view(tmp_path / "run.rrd", truth=true_circle())
    looks = [step for step in steps if step.looked]
    found = read_rows(tmp_path / "run.rrd")
    assert set(found) == {
        *("/map/nodes", "/map/links", "/cells/sheet", "/cells/headings", "/views/id"),
        *("/views/node", "/log"),
        *(f"/{kind}/{way}" for kind in ("way", "robot") for way in ("live", "dead_reckoning")),
        *("/way/truth", "/robot/truth"),
    }
    ids = [round(values["scalars"][0]) for _, _, values in found["/views/id"]]
    assert ids == [step.view_id for step in looks]
    nodes = [round(values["scalars"][0]) for _, _, values in found["/views/node"]]
    assert nodes == [step.node for step in looks if step.node is not None]
    log = [(stamp, values["text"]) for _, stamp, values in found["/log"]]
    assert log == [(step.stamp_ns, [step.why]) for step in steps if step.why]
    assert all(elapsed == stamp - START for of in found.values() for elapsed, stamp, _ in of)


def test_the_last_rows_are_the_map_and_the_pose_in_the_end(tmp_path: Path) -> None:
    slam, steps = record_view(tmp_path / "run.rrd")
    found = read_rows(tmp_path / "run.rrd")
    assert len(slam.map.nodes) > 2 and found["/map/nodes"][-1][1] == steps[-1].stamp_ns
    places = np.pad(slam.map.nodes[:, :2], ((0, 0), (0, 1)))
    np.testing.assert_allclose(last(found["/map/nodes"], "positions"), places, atol=1e-6)
    links = slam.map.links
    ends = np.stack([places[links["source"]], places[links["target"]]], axis=1)
    np.testing.assert_allclose(last(found["/map/links"], "strips"), ends, atol=1e-6)
    last_look = max(k for k, step in enumerate(steps) if step.looked)
    arrow = next(v for _, t, v in found["/robot/live"] if t == steps[last_look].stamp_ns)
    assert arrow["origins"][0][:2] == pytest.approx(steps[last_look].pose[:2], abs=1e-6)


def test_the_name_of_a_bag_is_no_warning(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    RerunView(tmp_path / "run.rrd", "small_house_20s.bag: a half / b").close()
    assert "WARN" not in capfd.readouterr().err


def test_the_activity_of_the_cells_is_shown_at_each_look(tmp_path: Path) -> None:
    slam, activity = RatSlam(), []
    with RerunView(tmp_path / "run.rrd") as view:
        for event in circle(2.0):
            step = slam.step(event)
            view.step(step, slam, event)
            if step.looked:
                activity.append(slam.cells.activity)
    found = read_rows(tmp_path / "run.rrd")
    assert len(found["/cells/sheet"]) == len(found["/cells/headings"]) == len(activity) == 4
    for cells, (_, _, sheet), (_, _, bars) in zip(
        activity, found["/cells/sheet"], found["/cells/headings"], strict=True
    ):
        tensor = sheet["data"][0]
        assert (tensor["shape"], tensor["names"]) == (list(cells.shape[1:]), ["y", "x"])
        np.testing.assert_allclose(tensor["buffer"], cells.sum(axis=0).ravel(), rtol=0, atol=1e-6)
        np.testing.assert_allclose(bars["values"][0]["buffer"], cells.sum(axis=(1, 2)), atol=1e-6)


def test_the_truth_is_drawn_from_the_start_as_far_as_it_is_known(tmp_path: Path) -> None:
    _, steps = record_view(tmp_path / "run.rrd", truth=true_circle())
    found = read_rows(tmp_path / "run.rrd")
    by_stamp = {step.stamp_ns: step.dead_reckoning for step in steps}
    known = [stamp for _, stamp, _ in found["/robot/truth"]]
    assert known[0] == START and max(known) - START <= 2.1e9
    for _, stamp, values in found["/robot/truth"]:
        if stamp <= START + 60 * 33 * MS:
            # Straight lines between the places of a small circle.
            assert values["origins"][0][:2] == pytest.approx(by_stamp[stamp][:2], abs=0.02)


def only_image(path: Path) -> Any:
    (row,) = read_rows(path)["/image"]
    return np.asarray(Image.open(io.BytesIO(bytes(row[2]["blob"][0]))))


def views_of_a_stripe() -> Any:
    """A grey picture 640 pixels wide whose left half is bright."""
    image = np.zeros((480, 640), np.uint8)
    image[:, :320] = 200
    return image


@rows("kind", ["picture", "frame", "item"])
def test_what_was_seen_is_shown_small(tmp_path: Path, kind: str) -> None:
    image = np.repeat(views_of_a_stripe()[..., None], 3, axis=2)
    slam = RatSlam(views=TemplateSource())
    event: Event = {
        "picture": Picture(stamp_ns=START, frame_id="camera", image=image),
        "frame": Frame(stamp_ns=START, images={"left": image}),
        "item": Look(START, image),
    }[kind]
    with RerunView(tmp_path / "run.rrd") as view:
        view.step(slam.step(event), slam, event)
    read = only_image(tmp_path / "run.rrd")
    assert read.shape == (240, 320, 3)
    np.testing.assert_allclose(read[:, [0, 100, 200, 319]].mean((0, 2)), [200, 200, 0, 0], atol=3)


def test_of_many_images_five_a_second_are_shown(tmp_path: Path) -> None:
    slam, image = RatSlam(views=TemplateSource()), views_of_a_stripe()
    with RerunView(tmp_path / "run.rrd") as view:
        for k in range(30):
            event = Look(START + k * 50 * MS, image)
            view.step(slam.step(event), slam, event)
    times = [elapsed for elapsed, _, _ in read_rows(tmp_path / "run.rrd")["/image"]]
    assert times == [k * 200 * MS for k in range(8)]


def test_of_what_a_template_keeps_its_blocks_are_shown(tmp_path: Path) -> None:
    source = TemplateSource()
    slam, kept = RatSlam(views=source), source.templates.view(views_of_a_stripe())
    event = Look(START, kept)
    with RerunView(tmp_path / "run.rrd") as view:
        view.step(slam.step(event), slam, event)
    read = only_image(tmp_path / "run.rrd")
    assert read.shape == (20, 60)
    np.testing.assert_allclose(read[:, [0, 20, 40, 59]].mean(0), [200, 200, 0, 0], atol=5)


def test_a_refused_loop_is_a_warning(tmp_path: Path) -> None:
    slam, events = RatSlam(), list(circle(0.5))
    with RerunView(tmp_path / "run.rrd") as view:
        for event in events:
            step = replace(slam.step(event), why="no loop", refused=None)
            view.step(step, slam, event)
        view.step(replace(step, stamp_ns=step.stamp_ns + 1, refused=step.action), slam)
    levels = [values["level"][0] for _, _, values in read_rows(tmp_path / "run.rrd")["/log"]]
    assert levels == ["INFO"] * len(events) + ["WARN"]


def test_a_run_says_the_same_twice(tmp_path: Path) -> None:
    record_view(tmp_path / "a.rrd", truth=true_circle())
    record_view(tmp_path / "b.rrd", truth=true_circle())
    assert read_rows(tmp_path / "a.rrd") == read_rows(tmp_path / "b.rrd")


def test_a_long_run_shows_its_map_less_and_less_often(tmp_path: Path) -> None:
    slam = RatSlam()
    with RerunView(tmp_path / "run.rrd") as view:
        step = slam.step(Motion(START, 0.0, 0.0))
        for second in range(1000):
            view.step(replace(step, stamp_ns=START + second * 10**9), slam)
    times = np.array([elapsed for elapsed, _, _ in read_rows(tmp_path / "run.rrd")["/map/nodes"]])
    gaps = np.diff(times[:-1]) / 1e9
    assert (gaps[times[:-2] < 100e9] == 1).all()
    assert (gaps >= np.floor(times[:-2] / 100e9)).all() and 250 < len(times) < 350


def test_an_interrupted_run_leaves_a_file_that_reads_up_to_there(tmp_path: Path) -> None:
    def interrupt() -> Iterator[Event]:
        yield from list(circle())[:40]
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        record_view(tmp_path / "run.rrd", interrupt())
    found = read_rows(tmp_path / "run.rrd")
    assert found["/map/nodes"][-1][0] == [e.stamp_ns for e in circle()][39] - START
    assert [path.name for path in tmp_path.iterdir()] == ["run.rrd"]


def test_until_it_is_closed_the_old_file_stays(tmp_path: Path) -> None:
    path = tmp_path / "run.rrd"
    path.write_text("old")
    slam, view = RatSlam(), RerunView(path)
    view.step(slam.step(Motion(START, 0.5, 0.0)), slam)
    assert path.read_text() == "old"
    view.close()
    view.close()
    assert read_rows(path)["/robot/live"]
    with pytest.raises(DataError, check=has_code("closed")):
        view.step(slam.step(Motion(START + MS, 0.5, 0.0)), slam)


def test_a_view_without_a_step_is_a_file_without_rows(tmp_path: Path) -> None:
    assert record_view(tmp_path / "run.rrd", [])[1] == []
    reader = chunks.RrdReader(tmp_path / "run.rrd")
    assert (len(reader.recordings()), len(reader.blueprints())) == (0, 1)


FILL = """
import resource
import numpy as np
resource.setrlimit(resource.RLIMIT_FSIZE, (200_000, 200_000))
from fusionslam import DataError
from fusionslam.ratslam import RatSlam, Sighting
from fusionslam.ratslam.events import Look
from fusionslam.report.live.rerun_view import RerunView
slam, noise = RatSlam(), np.random.default_rng(0)
try:
    with RerunView({path!r}) as view:
        for k in range(20):
            step = slam.step(Sighting(k * 10**9, k))
            view.step(step, slam, Look(0, noise.integers(0, 255, (240, 320, 3), np.uint8)))
except DataError as error:
    print(type(error).__name__, error)
"""


@pytest.mark.slow
def test_a_full_disk_is_an_error_and_leaves_no_file(tmp_path: Path) -> None:
    path = tmp_path / "run.rrd"
    command = [sys.executable, "-c", FILL.format(path=str(path))]
    result = subprocess.run(command, capture_output=True, text=True)
    assert result.stdout.startswith("DataError") and str(path) in result.stdout, result.stderr
    assert list(tmp_path.iterdir()) == []


def test_what_cannot_be_written_is_named_before_the_run(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    (tmp_path / "folder.rrd").mkdir()
    for name in ("file/run.rrd", "folder.rrd"):
        with pytest.raises(DataError, match=name):
            RerunView(tmp_path / name)
    with pytest.raises(ConfigError, match=r"run\.mcap"):
        RerunView(tmp_path / "run.mcap")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file", "folder.rrd"]


def test_without_rerun_the_extra_is_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setitem(sys.modules, "rerun", None)
    with pytest.raises(FusionSlamError, check=has_code("missing-extra", "live")):
        RerunView(tmp_path / "run.rrd")


class Viewer:
    """Stands for a viewer that starts, or does not, or that somebody closes."""

    def __init__(self, spawns: bool, stays: bool) -> None:
        self.spawns, self.stays, self.rows, self.left = spawns, stays, 0, False

    def spawn(self, **_: Any) -> None:
        if not self.spawns:
            raise RuntimeError("no executable")

    def flush(self, timeout_sec: float) -> None:
        if not self.stays and (self.rows or not self.spawns):
            raise RuntimeError("unable to connect")

    def log(self, *_: Any) -> None:
        self.rows += 1

    def send_blueprint(self, _: Any) -> None: ...

    def set_time(self, *_: Any, **__: Any) -> None: ...

    def set_log_time_enabled(self, _: bool) -> None: ...

    def disconnect(self) -> None:
        self.left = True


def test_a_viewer_that_does_not_start_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    viewer = Viewer(spawns=False, stays=False)
    monkeypatch.setattr("rerun.RecordingStream", lambda *_, **__: viewer)
    with pytest.raises(FusionSlamError, match="no executable", check=has_code("no-viewer")):
        RerunView()


def test_closing_the_viewer_does_not_end_the_run(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    viewer = Viewer(spawns=True, stays=False)
    monkeypatch.setattr("rerun.RecordingStream", lambda *_, **__: viewer)
    slam = RatSlam()
    with RerunView() as view:
        for event in circle(1.0):
            view.step(slam.step(event), slam, event)
    assert viewer.rows and viewer.left
    assert [record.levelname for record in caplog.records] == ["WARNING"]
