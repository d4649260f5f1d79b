# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""``RatSlam``: what each event does, and what it makes of views that make no sense."""

from typing import Any

import numpy as np
import pytest

from drives import (
    SECOND,
    circle_events,
    circles,
    errors_of,
    everything,
    grey_image,
    in_order,
    odometry,
    said,
    same,
    take,
    unchanged,
)
from error_codes import has_code
from fusionslam.errors import ConfigError, DataError, ShapeError
from fusionslam.ratslam import (
    ActionKind,
    ExperienceMap,
    Look,
    Motion,
    OnlineRatSlam,
    PoseCells,
    RatSlam,
    Sighting,
    StampOrder,
    Step,
    TemplateSource,
)
from fusionslam.ratslam.events import Event
from fusionslam.ratslam.view_sources import build_view_source
from fusionslam.sensors.frame import Frame
from fusionslam.sensors.messages import Picture
from refusals import refuses
from rows import rows
from streets import at

TENTH = SECOND // 10


@rows("event", [None, 3, "look", Motion])
def test_what_is_no_event_is_refused_by_its_type(event: Any) -> None:
    with refuses("no-event", type(event).__name__, error=ShapeError):
        RatSlam().step(event)


def test_odometry_of_a_frame_must_be_a_transform() -> None:
    with pytest.raises(ShapeError, check=lambda error: error.fields == ("odometry",)):
        RatSlam().step(Frame(odometry=np.eye(2)))
    transposed = np.eye(4)
    transposed[3, :3] = 1, 2, 0
    for pose in (transposed, 2 * np.eye(4), np.diag([1.0, -1, 1, 1])):
        with pytest.raises(DataError, check=has_code("not-a-rotation", "pose")):
            RatSlam().step(said(0, pose))


def straight(seconds: float) -> list[Event]:
    return [Motion(k * TENTH, 0.5, 0.0) for k in range(round(seconds * 10))]


def test_a_step_reports_all_changes() -> None:
    slam = RatSlam()
    first = slam.step(Sighting(0, 0))
    assert first.why
    assert (first.view_id, first.node, first.action.kind) == (0, None, ActionKind.NONE)
    assert slam.step(Motion(0, 0.5, 0.0)).why == ""
    step = slam.step(Motion(TENTH, 0.5, 0.1))
    assert step.why and step.action[:3] == (ActionKind.CREATE_NODE, 0, 0)
    assert (step.stamp_ns, step.view_id, step.node, step.looked) == (TENTH, None, 0, False)
    assert step.pose == pytest.approx(step.dead_reckoning) and step.cells == slam.cells.best
    assert slam.memory.node_views == [0] and slam.memory.node_stamps_ns == [TENTH]


def test_motions_and_sightings_of_three_laps_close_the_loop_against_drift() -> None:
    slam = RatSlam()
    events = circle_events(3.0)
    steps = take(slam, events)
    truth = np.stack(circles(3.0).places(np.array([s.stamp_ns for s in steps]) / 1e9), axis=1)
    live = errors_of([step.pose for step in steps], truth)
    alone = errors_of([step.dead_reckoning for step in steps], truth)
    assert alone > 0.2 and live < 0.6 * alone
    closed = [step for step in steps if step.action.kind == ActionKind.CREATE_EDGE]
    assert closed and all(step.loop is not None and step.loop.accepted for step in closed)
    assert len(slam.map.nodes) == len(slam.memory.node_views) == len(slam.memory.node_stamps_ns)


def test_odometry_arrives_faster_than_views_or_slower() -> None:
    way = circles(0.5)
    for rate_hz in (5.0, 50.0):
        slam = RatSlam()
        moves = [one for one in odometry(way, rate_hz=rate_hz) if one.stamp_ns < 99 * TENTH]
        seen = [Sighting(k * TENTH, k // 10) for k in range(1, 100)]
        steps = take(slam, in_order(moves, seen))
        assert {step.view_id for step in steps if step.looked} == set(range(10))
        assert slam.memory.node_views == list(range(10))


def test_frames_pictures_and_looks_go_to_the_source_of_views() -> None:
    slam = RatSlam(views=TemplateSource(bottom=100))
    pose = np.eye(4)
    frame = Frame(stamp_ns=0, images={"left": grey_image(20)}, odometry=pose)
    picture = Picture(stamp_ns=TENTH, frame_id="camera", image=grey_image(200))
    look = Look(2 * TENTH, grey_image(20))
    steps = take(slam, [frame, picture, look])
    assert [step.view_id for step in steps] == [0, 1, 0]
    assert all(step.looked for step in steps)
    assert (
        slam.step(Frame(stamp_ns=3 * TENTH, images={"left": grey_image(20)}, odometry=pose)).node
        == 0
    )


def test_an_unrecognised_item_is_no_view() -> None:
    slam = RatSlam()
    steps = take(slam, [*straight(0.3), Sighting(3 * TENTH, -1), Motion(4 * TENTH, 0.5, 0)])
    assert steps[-2].looked and steps[-2].view_id is None and steps[-2].why
    assert len(slam.map.nodes) == 0


@rows(
    "sighting",
    [
        *[Sighting(SECOND, view_id) for view_id in (2, -2, 10**12, 0.5, np.zeros(2))],
        Sighting(SECOND, 0, reason=3),
        *[Sighting(SECOND, 1, turn) for turn in (np.nan, np.inf)],
        Sighting(SECOND, 0, np.nan),
        Sighting(SECOND, 0, 0.0, (np.nan, 0.0)),
        *[Sighting(stamp_ns, 0) for stamp_ns in (0, -SECOND, np.nan, 2**64)],
        Look(SECOND, grey_image(0)),
    ],
)
def test_invalid_views_are_refused_and_change_nothing(sighting: Event) -> None:
    slam = RatSlam()
    take(slam, [Motion(0, 0.5, 0.0), Sighting(0, 0), Motion(TENTH, 0.5, 0.0)])
    with unchanged(slam), pytest.raises(DataError):
        slam.step(sighting)
    assert slam.step(Sighting(2 * SECOND, 1)).view_id == 1


def test_ids_and_stamps_may_be_numbers_of_numpy(tmp_path: Any) -> None:
    slam = RatSlam()
    events: list[Any] = [
        Motion(np.int64(0), np.float64(0.5), 0.0),
        Sighting(np.int64(0), np.int64(0)),
    ]
    take(slam, [*events, Motion(np.int64(TENTH), np.float32(0.5), 0.0)])
    slam.save(tmp_path / "s.npz")
    assert same(everything(RatSlam.load(tmp_path / "s.npz")), everything(slam))


def test_an_image_of_another_size_is_refused_but_odometry_beside_it_counts() -> None:
    slam = RatSlam(views=TemplateSource(bottom=100))
    poses = [at(0.05 * k, 0, 0) for k in range(3)]
    slam.step(Frame(stamp_ns=0, images={"left": grey_image(20)}, odometry=poses[0]))
    with pytest.raises(ShapeError):
        slam.step(Frame(stamp_ns=TENTH, images={"left": grey_image(20)[:, :90]}, odometry=poses[1]))
    step = slam.step(Frame(stamp_ns=2 * TENTH, images={"left": grey_image(20)}, odometry=poses[2]))
    assert step.view_id == 0 and step.dead_reckoning[0] == pytest.approx(0.1)


def test_templates_without_odometry_make_no_map_and_no_error() -> None:
    slam = RatSlam(views=TemplateSource(bottom=100))
    steps = take(slam, [Look(k * TENTH, grey_image(k % 5 * 40)) for k in range(200)])
    assert {step.view_id for step in steps} == {0, 1, 2, 3, 4}
    assert len(slam.map.nodes) == 0 and steps[-1].node is None
    assert steps[-1].pose == (0, 0, 0)


def test_odometry_without_views_is_dead_reckoning() -> None:
    slam = RatSlam()
    steps = take(slam, odometry(circles(0.5)))
    assert len(slam.map.nodes) == 0
    assert all(step.pose == step.dead_reckoning for step in steps)


def false_loops(preset: str) -> tuple[list[Step], float]:
    """A straight way of 40 m, on which every view after the first 20 m is said to be view 2."""
    slam = RatSlam(preset=preset)
    seen = [Sighting(k * TENTH + 1, min(k // 10, 40) if k < 400 else 2) for k in range(800)]
    steps = take(slam, in_order(straight(80), seen))
    far = [step.pose[0] - step.dead_reckoning[0] for step in steps]
    return steps, float(np.abs(far).max())


def test_a_false_loop_on_every_frame_folds_the_original_map_and_not_ours() -> None:
    _, folded = false_loops("openratslam")
    steps, error = false_loops("robust")
    assert folded > 10
    assert error < 0.5
    refused = [step for step in steps if step.refused is not None]
    assert refused
    for step in refused:
        assert not step.loop.accepted
        assert step.loop.reason in step.why and step.action.kind == ActionKind.CREATE_NODE
    assert not any(step.action.kind == ActionKind.CREATE_EDGE for step in steps)


def test_the_preset_goes_to_cells_and_map_and_single_values_stay() -> None:
    slam = RatSlam(preset="openratslam", cells={"size": 30}, map={"correction": 0.25})
    assert slam.cells.config.preset == slam.map.config.preset == slam.preset == "openratslam"
    assert slam.cells.config.size == 30 and slam.map.config.correction == 0.25
    assert RatSlam().preset == "robust"


@rows(
    "make, wrong",
    [
        (RatSlam, {"prese": ["robust"], "gap": [0]}),
        (StampOrder, {"wait": [-1]}),
        (PoseCells, {"size": [6, 1001], "cell_m": [0, np.inf], "inject": [-1], "delta_pc": [0]}),
        (PoseCells, {"step_s": [0], "global_inhibition": [1], "preset": ["fast"], "neurons": [3]}),
        (ExperienceMap, {"correction": [0.6], "loops": [-1], "preset": ["best"]}),
        (ExperienceMap, {"drift_m": [0.0], "sigma": [3]}),
    ],
)
def test_wrong_values_of_configurations_are_refused_by_name(make: Any, wrong: Any) -> None:
    for name, values in wrong.items():
        for value in values:
            with pytest.raises(ConfigError, match=name):
                make(**{name: value})


def test_what_maps_shows_what_it_holds_in_one_line() -> None:
    slam = RatSlam(views=build_view_source("objects"), preset="openratslam")
    take(slam, circle_events(0.3))
    graph = f"openratslam: {len(slam.map.nodes)} nodes, {len(slam.map.links)} links"
    assert graph in repr(slam.map) and graph in repr(slam) and "objects" in repr(slam)
    assert "36 x 20 x 20" in repr(slam.cells) and "openratslam" in repr(slam.cells)
    assert repr(RatSlam()) in repr(OnlineRatSlam())
    assert all("\n" not in repr(each) for each in (slam, slam.map, slam.cells))
