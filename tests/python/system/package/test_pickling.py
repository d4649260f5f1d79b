# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What is sent between processes arrives whole: configurations, data, detectors, errors."""

import pickle
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bags import drive, write_bag
from drives import (
    circle_events,
    everything,
    process_all,
    process_and_flush,
    replace_sightings,
    same,
    take,
)
from fusionslam.cli.system_config import SystemConfig
from fusionslam.config import Section
from fusionslam.datasets.streams import GapsError, MissingSensorError
from fusionslam.errors import ClockError, ConfigError, DataError, FusionSlamError, ShapeError
from fusionslam.evaluation import judge_map
from fusionslam.fleet.engines import WorkerDiedError
from fusionslam.fusion import FusionConfig
from fusionslam.geometry.odometry_noise import OdometryConfig
from fusionslam.loop_closure.loop import Loop
from fusionslam.pipelines.drives import open_drive
from fusionslam.pipelines.maps import run_ratslam
from fusionslam.pipelines.recording import FrameError
from fusionslam.pipelines.views import run_views
from fusionslam.ratslam import (
    ExperienceMap,
    MatcherSource,
    OnlineRatSlam,
    PoseCells,
    RatSlam,
    TemplateSource,
)
from fusionslam.ratslam.view_sources import build_view_source
from fusionslam.sensors.frame import Frame
from fusionslam.sensors.transforms import TransformError, TransformTree
from fusionslam.service.problems import RequestError
from fusionslam.views.matcher import ViewMatcher
from fusionslam.views.recognisers import ViewMatcherConfig
from kitti import odometry, raw_drive
from recordings import write_drive
from rows import rows
from scenes import LAPS, MeanColor, painted, place, two_stages
from scenes import drive as scenes_of


def sent(value: Any) -> Any:
    return pickle.loads(pickle.dumps(value))


@pytest.fixture(scope="module")
def worker() -> Iterator[ProcessPoolExecutor]:
    """A process that begins from nothing, as on other systems and in Ray."""
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        yield pool


def sections(section: Section) -> Iterator[Section]:
    yield section
    for name in type(section).model_fields:
        if isinstance(value := getattr(section, name), Section):
            yield from sections(value)


ALL_SECTIONS = [*sections(SystemConfig()), FusionConfig(frame="robot"), OdometryConfig(scale=1.1)]


@rows("config", ALL_SECTIONS)
def test_configurations_are_sent(config: Section) -> None:
    assert sent(config) == config and type(sent(config)) is type(config)


ERRORS = [
    FusionSlamError("broken", code="of-its-own", fields=("a", "b")),
    DataError("cut", code="cut", fields=("drive.bag",)),
    ClockError("back"),
    ConfigError("out of range", fields=("key",)),
    ShapeError("odd"),
    MissingSensorError("no left", fields=("left",)),
    FrameError("drive, frame 3: cut", code="cut", fields=("000003.bin",)),
    GapsError("gaps", fields=("path", "3")),
    TransformError("unknown", may_come=True, code="no-link", fields=("base", "lidar")),
    WorkerDiedError("killed", fields=("9",)),
    RequestError(429, "too many", code="rate", fields=("10",), headers={"Retry-After": "3"}),
]


def all_errors(kind: type[FusionSlamError] = FusionSlamError) -> set[type[FusionSlamError]]:
    return {kind}.union(*(all_errors(each) for each in kind.__subclasses__()))


@rows("error", ERRORS)
def test_errors_come_back(error: FusionSlamError) -> None:
    back = sent(error)
    assert type(back) is type(error) and str(back) == str(error) and vars(back) == vars(error)


def test_every_class_of_errors_is_tried() -> None:
    own = {each for each in all_errors() if each.__module__.startswith("fusionslam.")}
    assert own == {type(each) for each in ERRORS}


def test_an_error_of_another_process_is_the_error_itself(worker: ProcessPoolExecutor) -> None:
    tree = TransformTree()
    with pytest.raises(TransformError) as here:
        tree.lookup("base", "lidar", 0)
    with pytest.raises(TransformError) as there:
        worker.submit(tree.lookup, "base", "lidar", 0).result()
    assert vars(there.value) == vars(here.value) and str(there.value) == str(here.value)


@rows(
    "values",
    [
        {},
        {"policy": "several", "store_below": 1.0},
        {"method": "objects"},
        {"method": "cm2dp", "max_views": 3},
    ],
)
def test_a_matcher_takes_its_views_along(values: dict[str, Any]) -> None:
    one = ViewMatcher(ViewMatcherConfig(**values))
    run_views(scenes_of(LAPS), one)
    other = sent(one)
    assert other.config == one.config and other.stats == one.stats
    assert [other.process(place(n, 7)) for n in range(8)] == [
        one.process(place(n, 7)) for n in range(8)
    ]
    assert other.stats == one.stats


def test_a_matcher_with_a_second_stage_takes_its_views_along() -> None:
    pytest.importorskip("onnxruntime")
    shipped = ViewMatcher(ViewMatcherConfig(method="two_stages"))
    shipped.process(place(0))
    assert sent(shipped).process(place(0, 1)) == shipped.process(place(0, 1))


def test_a_matcher_takes_a_comparison_of_its_own_along() -> None:
    one = two_stages(MeanColor())
    one.process(painted(0, 0, 40))
    other = sent(one)
    for shade in (40, 200):
        assert other.process(painted(0, 1, shade)) == one.process(painted(0, 1, shade))
    assert other.stats == one.stats


def test_another_process_recognises_places(worker: ProcessPoolExecutor) -> None:
    one = ViewMatcher()
    run_views(scenes_of(LAPS), one)
    found = worker.submit(one.process, place(1, 7)).result()
    assert found == one.process(place(1, 7)) and not found.is_new


@rows("preset", ["robust", "openratslam"])
def test_a_map_is_continued_elsewhere(preset: str) -> None:
    events = circle_events(1.1)
    one = RatSlam(preset=preset)
    take(one, events[:200])
    other = sent(one)
    assert other.config == one.config and same(everything(other), everything(one))
    assert take(other, events[200:]) == take(one, events[200:])
    assert same(everything(other), everything(one))


def test_a_map_is_continued_in_another_process(worker: ProcessPoolExecutor) -> None:
    events = circle_events(0.3)
    one = RatSlam(views=build_view_source("objects"))
    take(one, events[:-1])
    assert worker.submit(one.step, events[-1]).result() == one.step(events[-1])


def test_an_online_map_is_continued_elsewhere_with_the_events_that_wait() -> None:
    messages = replace_sightings(circle_events(1.1))
    one = OnlineRatSlam()
    process_all(one, [object(), *messages[:200]])
    other = sent(one)
    assert other.refused == one.refused and other.last == one.last
    assert process_and_flush(other, messages[200:]) == process_and_flush(one, messages[200:])
    assert same(everything(other.slam), everything(one.slam))


@rows("name", ["alignment", "objects", "visual_templates"])
def test_view_sources_are_sent(name: str) -> None:
    source = build_view_source(name)
    rng = np.random.default_rng(1)
    images = rng.integers(0, 256, (3, 480, 640), dtype=np.uint8)
    items = images if isinstance(source, TemplateSource) else [place(n) for n in (0, 1, 0)]
    for stamp_ns, item in enumerate(items):
        source.look(item, stamp_ns)
    other = sent(source)
    assert other.to_bytes() == source.to_bytes()
    assert other.look(items[0], 9) == source.look(items[0], 9)
    assert isinstance(source, TemplateSource | MatcherSource)


def test_parts_of_a_map_are_sent() -> None:
    slam = RatSlam()
    take(slam, circle_events(0.5))
    graph, cells = sent(slam.map), sent(slam.cells)
    assert isinstance(graph, ExperienceMap) and isinstance(cells, PoseCells)
    assert graph.config == slam.map.config and graph.pose == slam.map.pose
    assert graph.nodes.tobytes() == slam.map.nodes.tobytes()
    assert cells.config == slam.cells.config and cells.best == slam.cells.best
    assert cells.activity.tobytes() == slam.cells.activity.tobytes()


def test_results_are_sent(tmp_path: Path) -> None:
    run = run_ratslam(write_drive(tmp_path / "drive.npz", laps=1), "objects")
    other = sent(run)
    assert other.poses.tobytes() == run.poses.tobytes() and other.why == run.why
    assert sent(judge_map(run)) == judge_map(run)
    views = run_views(scenes_of(LAPS), ViewMatcher()).with_truth("alignment")
    assert sent(views).ids.tolist() == views.ids.tolist()
    assert sent(views).judge("paper").metrics() == views.judge("paper").metrics()
    assert sent(Loop(3, 1, 0.1)) == Loop(3, 1, 0.1)


def content(frame: Frame) -> dict[str, Any]:
    """All of a frame, arrays as bytes."""
    arrays = {
        "points": frame.points,
        "colors": frame.colors,
        "pose": frame.pose,
        "odometry": frame.odometry,
        "robot_from_points": frame.robot_from_points,
        **frame.images,
    }
    cameras = {name: camera.projection.tobytes() for name, camera in frame.cameras.items()}
    plain = {name: None if a is None else (a.dtype, a.tobytes()) for name, a in arrays.items()}
    return {**plain, "cameras": cameras, "index": frame.index, "stamp_ns": frame.stamp_ns}


@rows("kind", ["kitti-odometry", "kitti-raw", "ranges", "rosbag1", "mcap"])
def test_recordings_and_their_frames_are_sent(
    tmp_path: Path, worker: ProcessPoolExecutor, kind: str
) -> None:
    if kind in ("rosbag1", "mcap"):
        pytest.importorskip("rosbags")
        path = tmp_path / ("drive.bag" if kind == "rosbag1" else "drive.mcap")
        write_bag(path, drive(1.0))
    elif kind == "ranges":
        path = write_drive(tmp_path / "drive.npz", laps=1)
    else:
        path = (odometry if kind == "kitti-odometry" else raw_drive)(tmp_path)
    data = open_drive(path).dataset
    assert data.kind == kind
    assert content(sent(data[1])) == content(data[1])
    other = sent(data)
    assert len(other) == len(data) and content(other[1]) == content(data[1])
    assert content(worker.submit(data.__getitem__, 1).result()) == content(data[1])
