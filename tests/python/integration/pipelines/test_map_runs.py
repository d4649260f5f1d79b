# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""RatSLAM over recordings: odometry of every kind, what cannot be read, and going on."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bags import START, without, write_bag
from bags import drive as bag_drive
from cli import interrupted_at
from drives import SECOND, circles, same
from error_codes import has_code
from fusionslam.errors import ConfigError, DataError, ShapeError
from fusionslam.evaluation.maps.judge import judge_map
from fusionslam.evaluation.maps.run import RatSlamRun
from fusionslam.geometry.odometry_noise import OdometryConfig
from fusionslam.pipelines.drives import Drive, open_drive
from fusionslam.pipelines.map_events import RunEvents, events_of, motions_of
from fusionslam.pipelines.maps import RunRecorder, join_runs, run_events, run_ratslam
from fusionslam.ratslam.events import Motion
from fusionslam.ratslam.slam import RatSlam, Step
from fusionslam.ratslam.view_sources import TemplateSource, build_view_source
from fusionslam.report.maps.page import write_ratslam_report
from fusionslam.sensors.messages import Odometry
from recordings import PLACES, write_drive
from refusals import refuses

OBJECTS = "objects"
Halfway = tuple[RatSlam, RatSlamRun, RunEvents]


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_drive(tmp_path_factory.mktemp("drive") / "drive.npz")


def parts(run: RatSlamRun) -> dict[str, Any]:
    """Everything but the times."""
    return {name: value for name, value in vars(run).items() if name != "step_seconds"}


def equal(one: RatSlamRun, other: RatSlamRun) -> bool:
    return same(parts(one), parts(other))


def test_a_recording_becomes_a_map_at_the_rates_of_its_sensors(recording: Path) -> None:
    seen: list[Step] = []
    run = run_ratslam(recording, OBJECTS, watch=lambda step, *_: seen.append(step))
    assert (run.name, run.views, run.odometry) == ("drive", "objects robust", "truth")
    # Scans every 2 s for 46 s, odometry 30 times a second.
    assert np.count_nonzero(run.is_view) == 2 * PLACES and len(run) > 30 * 46
    assert len(run) == len(seen) and np.all(np.diff(run.stamps_ns) >= 0)
    assert run.view_ids[run.is_view].tolist() == [*range(PLACES)] * 2
    assert run.truth is not None and np.isfinite(run.truth).all()
    # Odometry is the truth, and the way begins at the origin.
    np.testing.assert_allclose(run.dead_reckoning[:, :2], run.truth[:, :2], atol=1e-6)
    np.testing.assert_allclose(run.poses[:, :2], run.truth[:, :2], atol=0.05)
    assert run.activity_th.shape == (2 * PLACES, 36) and len(run.why) == 2 * PLACES


def test_odometry_with_errors_is_dead_reckoning_with_errors(recording: Path) -> None:
    errors = OdometryConfig(scale=1.1, speed_noise=0.01, seed=3)
    one = run_ratslam(recording, OBJECTS, "truth+noise", errors=errors)
    assert one.odometry == "truth with errors (scale 1.1, speed_noise 0.01, seed 3)"
    assert one.truth is not None
    way = np.abs(np.diff(one.truth[:, 0])).sum()
    assert np.abs(np.diff(one.dead_reckoning[:, 0])).sum() == pytest.approx(1.1 * way, rel=0.05)
    assert equal(one, run_ratslam(recording, OBJECTS, "truth+noise", errors=errors))
    other = errors.model_copy(update={"seed": 4})
    assert not equal(one, run_ratslam(recording, OBJECTS, "truth+noise", errors=other))


def test_what_is_not_there_is_said(recording: Path, tmp_path: Path) -> None:
    for views, odometry in (("visual_templates", None), (OBJECTS, "visual")):
        with refuses("no-images"):
            run_ratslam(recording, views, odometry)
    with pytest.raises(DataError, match="odometry"):
        run_ratslam(recording, OBJECTS, "topic")
    with pytest.raises(ConfigError, check=has_code("choice", "odometry", "wheels")):
        run_ratslam(recording, OBJECTS, "wheels")
    with np.load(recording) as stored:
        arrays = {name: stored[name] for name in stored.files if name != "poses"}
    np.savez(tmp_path / "blind.npz", **arrays)
    with refuses("no-motion"):
        run_ratslam(tmp_path / "blind.npz", OBJECTS)


def events(item: Any, looks: int = 10) -> RunEvents:
    motions = [Motion(k * SECOND // 10, 0.5, 0.0) for k in range(10 * looks)]
    stamps_ns = np.arange(1, looks + 1) * SECOND - SECOND // 2
    return RunEvents("street", "given", motions, stamps_ns, item)


def image(value: int) -> np.ndarray:
    return np.full((100, 120), 20 * value, np.uint8)


def recorder(item: Any) -> RunRecorder:
    return RunRecorder(RatSlam(views=TemplateSource(bottom=100)), events(item))


def run_of(taking: RunRecorder) -> RatSlamRun:
    run_events(taking)
    return taking.record()


def test_scans_that_cannot_be_read_are_left_out_and_noted() -> None:
    def item(index: int) -> Any:
        if index in (3, 4):
            raise DataError(f"scan {index} is cut short")
        return image(index)[:, : 90 if index == 6 else 120]

    run = run_of(recorder(item))
    assert np.count_nonzero(run.is_view) == 7
    assert run.view_ids[run.is_view].tolist() == list(range(7))
    assert [note for note in run.notes if "left out" in note][:2] == [
        "left out: scan 3 is cut short",
        "left out: scan 4 is cut short",
    ]
    assert len(run.notes) == 3 and "image" in run.notes[2]


def test_where_nothing_can_be_seen_the_first_reason_is_the_error() -> None:
    def item(index: int) -> Any:
        raise ShapeError(code="no-colors", fields=(str(index),))

    with pytest.raises(ShapeError, check=has_code("no-colors", 0)):
        run_of(recorder(item))


def test_a_run_that_is_interrupted_and_continued_equals_the_uninterrupted_one() -> None:
    whole = run_of(recorder(image))
    taking = recorder(image)
    with pytest.raises(KeyboardInterrupt):
        run_events(taking, watch=interrupted_at(60))
    first = taking.record()
    assert len(first) == 61
    going_on = RunRecorder(taking.slam, taking.events, earlier=first)
    assert equal(run_of(going_on), whole)
    with refuses("nothing-later"):
        run_events(going_on)
    twice = join_runs(whole, whole)  # without truth, as each part
    assert len(twice) == 2 * len(whole) and twice.truth is None
    assert len(twice.nodes) == len(whole.nodes) and len(twice.why) == 2 * len(whole.why)


def test_events_reach_from_before_the_first_look_to_after_the_last(recording: Path) -> None:
    source = build_view_source(OBJECTS)
    found = events_of(open_drive(recording), source)
    stamps = [motion.stamp_ns for motion in found.motions]
    assert stamps[0] <= found.look_stamps_ns[0] and stamps[1] > found.look_stamps_ns[0]
    assert stamps[-2] < found.look_stamps_ns[-1]
    order = [event.stamp_ns for event in found]
    assert order == sorted(order) and len(order) == len(found)


def test_a_bag_is_driven_by_its_topic_whatever_order_it_arrived_in(tmp_path: Path) -> None:
    pytest.importorskip("rosbags")
    in_turn = bag_drive(4.0)
    rng = np.random.default_rng(2)
    delayed = [
        replace(event, time_ns=event.time_ns + int(rng.uniform(0, 0.3) * SECOND))
        for event in in_turn
    ]
    late = sorted(delayed, key=lambda event: event.time_ns)
    runs = []
    for name, written in (("in_turn.bag", in_turn), ("late.bag", late)):
        write_bag(tmp_path / name, written)
        tour = open_drive(tmp_path / name)
        source = TemplateSource(columns=16, rows=8, bottom=None)
        taking = RunRecorder(RatSlam(views=source), events_of(tour, source))
        runs.append(replace(run_of(taking), name="bag"))
    assert runs[0].odometry == "topic /odom"
    assert len(runs[0].nodes) == 3 and np.count_nonzero(runs[0].is_view) == 41
    assert equal(*runs)


def test_a_recording_in_two_parts_gives_the_same_map_as_in_one(tmp_path: Path) -> None:
    pytest.importorskip("rosbags")
    # Between two images, with odometry messages on either side.
    cut, whole = START + 2 * SECOND + SECOND // 20, list(without(bag_drive(4.0), "/points"))

    def mapped(
        name: str, events: list[Any], slam: RatSlam | None = None, **parts: Any
    ) -> tuple[RatSlam, RatSlamRun]:
        write_bag(tmp_path / name, events)
        views = TemplateSource(columns=16, rows=8, bottom=None) if slam is None else slam.views
        assert isinstance(views, TemplateSource)
        found = events_of(open_drive(tmp_path / name), views, resumed=slam is not None, **parts)
        taking = RunRecorder(slam or RatSlam(views=views), replace(found, name="bag"))
        return taking.slam, run_of(taking)

    slam, first = mapped("1.bag", [e for e in whole if e.time_ns < cut], continued=True)
    slam.save(tmp_path / "state.npz")
    later = [e for e in whole if e.time_ns >= cut or e.topic == "/tf_static"]
    _, second = mapped("2.bag", later, RatSlam.load(tmp_path / "state.npz"))
    _, expected = mapped("whole.bag", whole)
    assert equal(join_runs(first, second), expected)


@pytest.fixture(scope="module")
def first_half(
    recording: Path, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Path, RatSlamRun, RunEvents]:
    source = build_view_source(OBJECTS)
    whole = events_of(open_drive(recording), source)
    stamps_ns = whole.look_stamps_ns[:PLACES]
    motions = [one for one in whole.motions if one.stamp_ns <= stamps_ns[-1]]
    half = replace(whole, motions=motions, look_stamps_ns=stamps_ns)
    taking = RunRecorder(RatSlam(views=source), half)
    run = run_of(taking)
    state = tmp_path_factory.mktemp("half") / "state.npz"
    taking.slam.save(state)
    return state, run, whole


@pytest.fixture
def halfway(first_half: tuple[Path, RatSlamRun, RunEvents]) -> Halfway:
    """A map of the first half of a drive, its run, and the events of the whole drive."""
    state, run, whole = first_half
    return RatSlam.load(state), run, whole


@pytest.mark.parametrize(("name", "warned"), [("drive", 0), ("longer", 1)])
def test_the_recording_of_the_map_goes_on_and_under_another_name_is_warned_of(
    halfway: Halfway, name: str, warned: int, caplog: pytest.LogCaptureFixture
) -> None:
    slam, earlier, whole = halfway
    run = run_of(RunRecorder(slam, replace(whole, name=name), earlier=earlier))
    assert np.count_nonzero(run.is_view) == 2 * PLACES
    said = [entry.getMessage() for entry in caplog.records]
    assert len(said) == warned and all(f"{PLACES} of {2 * PLACES}" in text for text in said)


def test_another_recording_within_the_time_of_the_map_is_refused(halfway: Halfway) -> None:
    slam, earlier, whole = halfway
    other = replace(whole, name="other", look_stamps_ns=whole.look_stamps_ns - SECOND // 100)
    with refuses("stamps-overlap", "other", str(PLACES)):
        run_events(RunRecorder(slam, other, earlier=earlier))


@pytest.mark.parametrize(
    ("gap_s", "looks", "warned"), [(2, 3, 0), (3600, 3, 1), (2, 0, 0), (2, 1, 0)]
)
def test_a_later_recording_is_warned_of_unless_it_follows_at_once(
    halfway: Halfway, gap_s: int, looks: int, warned: int, caplog: pytest.LogCaptureFixture
) -> None:
    slam, earlier, whole = halfway  # its views are 2 s apart
    end_ns = slam.seen_ns[1]
    assert end_ns is not None
    later_ns = end_ns + gap_s * SECOND + np.arange(looks) * 2 * SECOND
    motion = Motion(end_ns + gap_s * SECOND, 0.5, 0.0)
    later = replace(whole, name="later", motions=[motion], look_stamps_ns=later_ns)
    taking = RunRecorder(slam, later, earlier=earlier)
    run_events(taking)
    assert [entry.args for entry in caplog.records] == [("later", gap_s)] * warned
    assert len(taking.record()) == len(earlier) + 1 + looks


def test_a_part_without_truth_leaves_that_of_the_other(halfway: Halfway) -> None:
    _, run, _ = halfway
    blind = replace(run, truth=None)
    for joined, known in (
        (join_runs(blind, run), slice(len(run), None)),
        (join_runs(run, blind), slice(len(run))),
    ):
        assert joined.truth is not None and len(joined.truth) == 2 * len(run)
        assert np.isfinite(joined.truth).sum() == 3 * len(run)
        assert np.isfinite(joined.truth[known]).all()


@pytest.mark.slow
def test_a_map_whose_truth_is_known_in_part_has_a_page(halfway: Halfway, tmp_path: Path) -> None:
    _, run, _ = halfway
    assert run.truth is not None
    for half in (slice(len(run) // 2), slice(len(run) // 2, None)):
        truth = run.truth.copy()
        truth[half] = np.nan
        known = replace(run, truth=truth)
        page = write_ratslam_report(tmp_path, known, judge_map(known))
        assert "<img" in page.read_text(encoding="utf-8")


def test_odometry_of_made_truth_is_that_of_the_simulator() -> None:
    class Walk(Drive):
        def __init__(self) -> None:
            self.name, self.truth, self.dataset = "walk", circles(0.1), None

    title, motions = motions_of(Walk(), "truth", OdometryConfig(scale=2.0))
    assert title == "truth" and all(isinstance(one, Odometry) for one in motions)
    end = motions[-1]
    assert isinstance(end, Odometry)
    x, y, yaw = circles(0.1).places(end.stamp_ns / 1e9)
    np.testing.assert_allclose(end.pose[:2, 3], [x, y], atol=1e-6)
    assert np.arctan2(end.pose[1, 0], end.pose[0, 0]) == pytest.approx(float(yaw))
