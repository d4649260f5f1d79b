# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Scan Context by name: its options, the frames that it allows, and its metric everywhere."""

import math

import numpy as np
import pytest
from numpy.typing import NDArray

import fusionslam
from fusionslam import Camera, Cloud, ConfigError, DescriptorConfig, Frame, FusionConfig
from fusionslam._core import ScanContextConfig
from fusionslam.config import merged
from fusionslam.descriptors import for_clouds, length_of
from fusionslam.evaluation import find_matches, precision_recall
from fusionslam.evaluation.loops.nearest_matches import pairwise_distances
from refusals import refuses
from rows import rows

UP = "scan_context"
CAMERA = Camera(np.array([[30.0, 0, 32, 0], [0, 30, 24, 0], [0, 0, 1, 0]]))
"""Its points lie in its own frame: z ahead."""


def street(seed: int, turn: float = 0.0) -> Cloud:
    """Walls about the origin, higher where the seed says, seen after a turn to the left."""
    rng = np.random.default_rng(seed)
    azimuth = rng.uniform(0, 2 * np.pi, 4000)
    walls = rng.uniform(5, 60, 60)[(azimuth / (2 * np.pi) * 60).astype(int)]
    height = rng.uniform(-1.5, 6, 60)[(azimuth / (2 * np.pi) * 60).astype(int)]
    x, y = walls * np.cos(azimuth - turn), walls * np.sin(azimuth - turn)
    return Cloud(np.stack([x, y, height], 1).astype(np.float32))


def turned(degrees: float) -> NDArray[np.float64]:
    """robot_from_points of a scanner that is pitched."""
    pose = np.eye(4)
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    pose[:3, :3] = [[c, 0, s], [0, 1, 0], [-s, 0, c]]
    return pose


def test_the_options_are_those_of_the_function() -> None:
    cloud = street(1)
    config = merged(
        DescriptorConfig(), {"scan_context": {"rings": 10, "max_range": 40.0, "height": 1.0}}
    )
    expected = fusionslam.scan_context(
        cloud.points, config=ScanContextConfig(rings=10, max_range=40.0, height=1.0)
    )
    np.testing.assert_array_equal(fusionslam.describe(cloud, UP, config), expected)
    assert length_of(UP, config) == 600
    np.testing.assert_array_equal(
        fusionslam.describe(cloud, UP), fusionslam.scan_context(cloud.points)
    )


def test_the_origin_is_at_a_cars_height_in_the_scans_frame_and_on_the_ground_in_the_robots() -> (
    None
):
    scan, robot = FusionConfig(), FusionConfig(frame="robot")
    given = merged(DescriptorConfig(), {"scan_context": {"height": 0.3}})
    cloud = street(1)
    for fusion, config, height in [
        (scan, DescriptorConfig(), 2.0),
        (scan, given, 0.3),
        (robot, DescriptorConfig(), 0.0),
        (robot, given, 0.3),
    ]:
        found = fusionslam.describe(cloud, UP, for_clouds(config, UP, fusion))
        np.testing.assert_array_equal(found, fusionslam.scan_context(cloud.points, height=height))
    assert for_clouds(given, "m2dp", robot) is given


@rows(
    "values, key",
    [
        ({"frame": "camera"}, "fusion.frame"),
        ({"frame": "odometry"}, "fusion.frame"),
        ({"up": "-y"}, "fusion.up"),
    ],
)
def test_clouds_in_other_frames_are_refused(values: dict[str, str], key: str) -> None:
    fusion = FusionConfig.model_validate(values)
    with pytest.raises(ConfigError) as caught:
        fusionslam.LoopDetector(UP, fusion=fusion)
    assert (caught.value.code, caught.value.fields[0]) == ("not-up", key)
    fusionslam.LoopDetector("m2dp", fusion=fusion)


def test_scans_whose_calibration_says_that_z_is_not_up_are_refused() -> None:
    cloud = FusionConfig(source="cloud")
    tilted = Frame(points=street(1).points, robot_from_points=turned(50))
    optical = Frame(points=street(1).points, cameras={"left": CAMERA})
    for frame in (tilted, optical):
        detector = fusionslam.LoopDetector(UP, fusion=cloud)
        with refuses("not-up", "scan"):
            detector.add(frame)
        assert len(detector) == 0
    ahead = np.array([[0.0, -1, 0, 0], [0, 0, -1, 0], [1, 0, 0, 0], [0, 0, 0, 1]])
    camera = Camera(CAMERA.projection, rectified_from_points=ahead)
    for frame in (
        Frame(points=street(1).points, robot_from_points=turned(40)),
        Frame(points=street(1).points, cameras={"left": camera}),
        Frame(points=street(1).points),
    ):
        fusionslam.LoopDetector(UP, fusion=cloud).add(frame)
    robot = FusionConfig(source="cloud", frame="robot")
    fusionslam.LoopDetector(UP, fusion=robot).add(tilted)


def test_turned_views_are_matched_by_their_metric_alone() -> None:
    order = [0, 1, 2, 3, 4, 2, 0, 4]
    turns = np.linspace(0, 2 * np.pi, len(order), endpoint=False)
    clouds = [street(seed, turn) for seed, turn in zip(order, turns, strict=True)]
    rows = np.array([fusionslam.describe(cloud, UP) for cloud in clouds])
    found = find_matches(rows, window=1, k=1, metric=UP)
    assert found.indices[5:, 0].tolist() == [2, 0, 4]
    places = np.array([[100.0 * seed, 0, 0] for seed in order])
    assert precision_recall(rows, places, window=1, metric=UP).top1 == 1
    assert precision_recall(rows, places, window=1).top1 != 1
    with pytest.raises(ConfigError):
        find_matches(rows, window=1, metric="cosine")


@rows("metric", ["l2", UP])
def test_distances_of_all_pairs_are_those_pair_by_pair(metric: str) -> None:
    rows = np.array([fusionslam.describe(street(seed % 4), UP) for seed in range(6)])
    distances = pairwise_distances(rows, metric)
    for i, one in enumerate(rows):
        for j, other in enumerate(rows):
            expected = (
                fusionslam.compare_scan_contexts(one, other)[0]
                if metric == UP
                else np.linalg.norm(one - other)
            )
            assert distances[i, j] == pytest.approx(expected, rel=1e-5, abs=1e-6)
    assert pairwise_distances(rows[:0], metric).shape == (0, 0)
