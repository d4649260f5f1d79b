# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""LoopDetector: finds what was seen before, forgets what it may, refuses bad input."""

import pickle
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from detector_places import DRIVE, PLACES, SECOND, place, wander
from error_codes import has_code
from fusionslam import (
    Camera,
    Cloud,
    ConfigError,
    DataError,
    DescriptorConfig,
    Frame,
    FusionConfig,
    FusionSlamError,
    Loop,
    LoopConfig,
    LoopDetector,
    ShapeError,
    cloud_resolution,
    describe,
    nearest_causal,
)
from fusionslam.descriptors import DESCRIPTORS, USUAL, for_sequence
from fusionslam.loop_closure import default_threshold
from fusionslam.loop_closure.observation import FrameObserver
from fusionslam.registration import RegistrationConfig
from refusals import refuses
from rows import rows
from threads import run_together

IMAGE = np.zeros((8, 8, 3), np.uint8)


@rows("descriptor", USUAL)
def test_a_place_seen_again_is_a_loop(descriptor: str) -> None:
    detector = LoopDetector(descriptor, threshold=10.0, window=3)
    for cloud in DRIVE[:PLACES]:
        detector.add(cloud)
    found = [detector.add(cloud) for cloud in DRIVE[PLACES:]]
    assert [(loop.query, loop.match) for loop in found if loop] == [(12, 2), (13, 3), (14, 7)]
    assert len(detector) == len(DRIVE)


def test_a_loop_carries_the_distance_of_the_two_descriptors() -> None:
    detector = LoopDetector("m2dp", threshold=1.0, window=3)
    loops = [detector.add(cloud) for cloud in DRIVE]
    vectors = [describe(cloud, "m2dp") for cloud in DRIVE]
    assert loops[12].distance == pytest.approx(np.linalg.norm(vectors[12] - vectors[2]), rel=1e-4)


@rows("source, name", product(["lidar", "stereo", "cloud"], [*USUAL, "m2dp:author", "cm2dp:paper"]))
def test_usual_descriptors_have_a_threshold_for_every_source(name: str, source: str) -> None:
    fusion = FusionConfig.model_validate({"source": source})
    detector = LoopDetector(name, fusion=fusion)
    assert 0 < detector.threshold == default_threshold(name, source=source) < 1
    assert LoopDetector(name, fusion=fusion, threshold=0.5).threshold == 0.5
    kind, _, preset = name.partition(":")
    if preset:
        describe_config = DescriptorConfig.model_validate({"preset": preset})
        same = LoopDetector(kind, describe=describe_config, fusion=fusion)
        assert same.threshold == detector.threshold
        assert detector.describe_config.preset == preset


@rows("name", [name for name in DESCRIPTORS if name not in USUAL])
def test_others_need_a_threshold_or_verification(name: str) -> None:
    with pytest.raises(ConfigError, check=has_code("no-threshold", name, "lidar")):
        LoopDetector(name, verify=False)
    assert LoopDetector(name, threshold=0.5).threshold == 0.5


def test_a_stored_detector_keeps_the_threshold_that_it_was_made_with(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    detector = LoopDetector("m2dp")
    detector.add(DRIVE[0])
    detector.save(tmp_path)
    monkeypatch.setattr(f"{LoopDetector.__module__}.default_threshold", lambda *_: 0.77)
    assert LoopDetector("m2dp").threshold == 0.77
    assert LoopDetector.load(tmp_path).threshold == detector.threshold


def test_only_distances_up_to_the_threshold_are_loops() -> None:
    distance = 0.25
    for threshold, accepted in [(0.2499, False), (0.25, True), (0.3, True), (0.0, False)]:
        detector = LoopDetector(threshold=threshold, window=0, length=4)
        detector.add_descriptor(np.ones(4, np.float32))
        loop = detector.add_descriptor(np.array([1 + distance, 1, 1, 1], np.float32))
        assert (loop is not None) == accepted
        assert detector.nearest == Loop(1, 0, distance)


@rows("window", [0, 1, 4])
def test_frames_within_the_window_are_no_candidates(window: int) -> None:
    detector = LoopDetector(threshold=0.0, window=window, length=3)
    same = np.ones(3, np.float32)
    loops = [detector.add_descriptor(same) for _ in range(8)]
    assert [loop and loop.match for loop in loops] == [None] * (window + 1) + [0] * (7 - window)


def test_frames_within_the_seconds_are_no_candidates() -> None:
    detector = LoopDetector(threshold=0.0, window=0, window_seconds=2.0, length=3)
    same = np.ones(3, np.float32)
    loops = [detector.add_descriptor(same, stamp_ns=n * SECOND // 2) for n in range(8)]
    assert [loop is not None for loop in loops] == [False] * 5 + [True] * 3
    assert detector.nearest == Loop(7, 0, 0.0)


def test_a_descriptor_of_zeros_takes_a_number_and_matches_nothing(tmp_path: Path) -> None:
    detector = LoopDetector(threshold=9.0, window=0, length=3)
    zeros, ones = np.zeros(3, np.float32), np.ones(3, np.float32)
    for given, match in [(zeros, None), (zeros, None), (ones, None), (zeros, None), (ones, 2)]:
        loop = detector.add_descriptor(given)
        assert loop == (None if match is None else Loop(len(detector) - 1, match, 0.0))
        assert detector.nearest == loop
        detector.save(tmp_path)
        detector = LoopDetector.load(tmp_path)
    assert len(detector) == 5 and detector.frames.tolist() == [2, 4]


def test_a_detector_says_what_it_is_in_a_line() -> None:
    detector = LoopDetector("cm2dp:author", threshold=0.25, window=7, length=3)
    detector.add_descriptor(np.ones(3, np.float32))
    line = repr(detector)
    assert "\n" not in line
    for part in ("LoopDetector", "cm2dp:author", "lidar", "0.25", "window 7", "1 frame added"):
        assert part in line


def test_the_nearest_candidate_is_known_even_if_it_is_no_loop() -> None:
    detector = LoopDetector("m2dp", threshold=0.0, window=3)
    assert detector.nearest is None
    for cloud in DRIVE:
        assert detector.add(cloud) is None
    assert detector.nearest.match == 7


def test_a_frame_is_fused_and_its_stamp_is_used() -> None:
    camera = Camera(np.array([[30.0, 0, 32, 0], [0, 30, 24, 0], [0, 0, 1, 0]]))
    image = np.random.default_rng(1).integers(0, 256, (48, 64, 3), dtype=np.uint8)

    def frame(number: int, stamp_ns: int) -> Frame:
        points = place(number).points[:, [1, 2, 0]]
        seen = {"images": {"left": image}, "cameras": {"left": camera}}
        return Frame(index=number, stamp_ns=stamp_ns, points=points, **seen)

    detector = LoopDetector("cm2dp", threshold=0.1, window=0, window_seconds=10.0)
    assert detector.add(frame(0, 0)) is None is detector.add(frame(1, 5 * SECOND))
    assert detector.nearest is None  # five seconds ago is too fresh
    loop = detector.add(frame(0, 11 * SECOND))
    assert (loop.query, loop.match) == (2, 0)


def test_the_configurations_are_obeyed() -> None:
    describe_config = DescriptorConfig(preset="author", color_space="hsv")
    detector = LoopDetector(
        "cm2dp",
        config=LoopConfig(threshold=9.0, window=3),
        window=1,
        describe=describe_config,
        fusion=FusionConfig(source="cloud"),
    )
    assert (detector.config.threshold, detector.config.window) == (9.0, 1)
    for cloud in DRIVE[:5]:
        detector.add(Frame(points=cloud.points, colors=cloud.colors))
    vectors = [describe(cloud, "cm2dp", describe_config) for cloud in DRIVE[:5]]
    distances = [float(np.linalg.norm(vectors[4] - other)) for other in vectors[:3]]
    assert detector.nearest.match == int(np.argmin(distances))
    assert detector.nearest.distance == pytest.approx(min(distances), rel=1e-4)


def test_the_first_cloud_fixes_the_radius_for_normals() -> None:
    detector = LoopDetector("shot", window=0, verify=False)
    for cloud in DRIVE[:3]:
        detector.add(cloud)
    radius = 5 * cloud_resolution(DRIVE[0].points)
    assert detector.describe_config.normal_radius == pytest.approx(radius)
    vectors = [describe(c, "shot", DescriptorConfig(normal_radius=radius)) for c in DRIVE[:3]]
    expected = min(float(np.linalg.norm(vectors[2] - other)) for other in vectors[:2])
    assert detector.nearest.distance == pytest.approx(expected, rel=1e-4)


@rows(
    "descriptor, window", product(["m2dp", "scan_context", "cscan_context", "bev_spectrum"], [0, 3])
)
def test_the_candidates_are_the_nearest_frames_before_the_window(
    descriptor: str, window: int, tmp_path: Path
) -> None:
    detector = LoopDetector(descriptor, window=window, verify=False)
    assert detector.candidates(3) == []
    metric = DESCRIPTORS[descriptor].metric
    config = for_sequence(DescriptorConfig(), [descriptor], DRIVE[0])
    vectors = np.array([describe(cloud, descriptor, config) for cloud in DRIVE])
    indices, distances = nearest_causal(vectors, window=window, k=4, metric=metric)
    for number, cloud in enumerate(DRIVE):
        detector.add(cloud, stamp_ns=number * SECOND)
        rows = indices[number] >= 0
        expected = [*zip(indices[number, rows], distances[number, rows], strict=True)]
        assert detector.candidates(4) == expected and detector.candidates(1) == expected[:1]
        nearest = detector.nearest
        assert (nearest and (nearest.match, nearest.distance)) == (expected or [None])[0]
    detector.save(tmp_path)
    assert LoopDetector.load(tmp_path).candidates(4) == expected
    assert pickle.loads(pickle.dumps(detector)).candidates(4) == expected
    assert len(detector.candidates(99)) == len(DRIVE) - 1 - window
    with refuses("choice", "k", "0", error=ConfigError):
        detector.candidates(0)


def test_candidates_leave_out_what_is_too_fresh_or_forgotten_or_zero() -> None:
    detector = LoopDetector(threshold=9.0, length=3)
    detector.add_descriptor(np.zeros(3, np.float32))
    assert detector.candidates(9) == []
    detector = LoopDetector(window=0, window_seconds=2.0, length=3, max_frames=8)
    for second in range(8):
        detector.add_descriptor(np.full(3, 1 + second, np.float32), stamp_ns=second * SECOND)
        old = [number for number in detector.frames.tolist() if number < second - 2]
        assert sorted(number for number, _ in detector.candidates(9)) == old
    assert len(detector.frames) < 8
    detector.add_descriptor(np.zeros(3, np.float32), stamp_ns=9 * SECOND)
    assert detector.candidates(9) == []


# Memory and threads


def test_a_bounded_detector_keeps_the_first_visit_to_every_place() -> None:
    descriptors = wander(places=60, frames=3000)
    detector = LoopDetector(threshold=0.5, window=2, max_frames=100, length=8)
    for row in descriptors:
        detector.add_descriptor(row)
        assert len(detector.frames) < 100
    assert len(detector) == 3000
    assert set(range(60)) <= set(detector.frames.tolist())
    for k in range(50):  # not seen for 2900 frames
        assert detector.add_descriptor(descriptors[k]) == Loop(3000 + k, k, 0.0)


def test_the_newest_frames_are_never_forgotten() -> None:
    detector = LoopDetector(threshold=9.0, window=7, max_frames=20, length=8)
    for count, row in enumerate(wander(places=20, frames=300), start=1):
        loop = detector.add_descriptor(row)
        assert loop is None or loop.query - loop.match > 7
        newest = detector.frames[-min(count, 7) :]
        assert newest.tolist() == list(range(count - len(newest), count))


def test_below_the_bound_nothing_is_forgotten_and_nothing_changes() -> None:
    bounded = LoopDetector(threshold=0.5, window=3, max_frames=301, length=8)
    free = LoopDetector(threshold=0.5, window=3, max_frames=0, length=8)
    for row in wander(places=60, frames=300):
        assert bounded.add_descriptor(row) == free.add_descriptor(row)
    assert len(bounded.frames) == 300


def test_a_bounded_detector_is_saved_and_pickled_with_what_it_has_left(tmp_path: Path) -> None:
    descriptors = wander(places=30, frames=200)
    detector = LoopDetector(threshold=0.5, window=2, max_frames=50, length=8)
    for row in descriptors[:150]:
        detector.add_descriptor(row)
    detector.save(tmp_path)
    for copy in (LoopDetector.load(tmp_path), pickle.loads(pickle.dumps(detector))):
        assert len(copy) == 150 and np.array_equal(copy.frames, detector.frames)
        original = LoopDetector.load(tmp_path)
        for row in descriptors[150:]:
            assert copy.add_descriptor(row) == original.add_descriptor(row)
        assert np.array_equal(copy.frames, original.frames)


@rows("descriptor", ["m2dp", "shot"])
def test_frames_that_threads_add_first_at_once_are_all_kept(descriptor: str) -> None:
    for _ in range(2):
        detector = LoopDetector(descriptor, window=0)
        run_together(*[partial(detector.add, cloud) for cloud in DRIVE[:3]])
        assert len(detector) == 3 and detector.frames.tolist() == [0, 1, 2]
        for cloud in DRIVE[:3]:  # all three were stored with the same radius
            detector.add(cloud)
            assert detector.nearest.distance < 1e-6


def test_no_number_is_given_twice_or_lost_while_threads_add_and_frames_are_forgotten() -> None:
    detector = LoopDetector(threshold=9.0, window=0, max_frames=40, length=8)
    descriptors, queries = wander(places=30, frames=400), []

    def add_all(part: Any) -> None:
        for row in part:
            if loop := detector.add_descriptor(row):
                queries.append(loop.query)

    run_together(*[partial(add_all, descriptors[k::4]) for k in range(4)])
    assert len(detector) == 400 and sorted(queries) == list(range(1, 400))


# Bad input

BAD_CLOUDS = [
    Cloud(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.uint8)),
    Cloud(DRIVE[0].points[:3], DRIVE[0].colors[:3]),
    Cloud(np.ones((50, 3), np.float32), np.zeros((50, 3), np.uint8)),
    Cloud(DRIVE[0].points * [[np.nan, 1, 1]], DRIVE[0].colors),
    Cloud(DRIVE[0].points),
    Cloud(DRIVE[0].points, DRIVE[0].colors[:-1]),
    Cloud(DRIVE[0].points.astype(int), DRIVE[0].colors),
]


@rows("descriptor", ["cm2dp", "cshot"])
def test_a_bad_cloud_adds_nothing_and_the_drive_goes_on(descriptor: str) -> None:
    disturbed = LoopDetector(descriptor, threshold=0.5, window=3)
    plain = LoopDetector(descriptor, threshold=0.5, window=3)
    for number, cloud in enumerate(DRIVE[:8]):
        for bad in BAD_CLOUDS if number in (0, 5) else []:
            with pytest.raises(FusionSlamError):
                disturbed.add(bad)
            assert len(disturbed) == number
        assert disturbed.add(cloud) == plain.add(cloud)
        assert disturbed.nearest == plain.nearest
    assert disturbed.describe_config == plain.describe_config


def test_a_first_cloud_too_thin_for_normals_does_not_fix_their_radius() -> None:
    thin = Cloud(np.array([[0, 0, 0], [9, 0, 0], [0, 50, 0], [0, 0, 400]], np.float32))
    detector = LoopDetector("shot", window=0)
    with pytest.raises(DataError):
        detector.add(thin)
    assert detector.describe_config.normal_radius is None


def test_a_bad_first_descriptor_fixes_nothing() -> None:
    detector = LoopDetector("m2dp", window=0)
    with pytest.raises(DataError):
        detector.add_descriptor(np.full(192, np.nan, np.float32))
    shapes = [np.zeros(shape, np.float32) for shape in ((192, 1), 0, 191)]
    for bad in (None, np.zeros(192, int), *shapes):
        with pytest.raises(ShapeError):
            detector.add_descriptor(bad)
    assert len(detector) == 0
    detector.add_descriptor(np.zeros(192, np.float32))
    with pytest.raises(ShapeError):
        detector.add_descriptor(np.zeros(5, np.float32))
    assert len(detector) == 1


def test_a_missing_stamp_adds_nothing() -> None:
    detector = LoopDetector(window_seconds=2.0, length=4)
    with pytest.raises(ConfigError, match="stamp_ns"):
        detector.add_descriptor(np.zeros(4, np.float32))
    assert len(detector) == 0


@rows(
    "name, value, text",
    [
        ("descriptor", "m3dp", "'m3dp'"),
        *[("threshold", value, rf"loop_closure\.threshold .*{value}") for value in (-0.1, np.nan)],
        *[("window", value, rf"loop_closure\.window .*{value}") for value in (-1, 2.5)],
        ("window_seconds", np.inf, r"loop_closure\.window_seconds .*\binf"),
    ],
)
def test_options_out_of_range_are_refused(name: str, value: Any, text: str) -> None:
    with pytest.raises(ConfigError, match=text):
        LoopDetector(**{name: value})


def test_items_other_than_frames_and_clouds_are_refused() -> None:
    detector = LoopDetector("m2dp")
    with pytest.raises(ShapeError, match="ndarray"):
        detector.add(np.ones((9, 3), np.float32))
    assert len(detector) == 0


@rows(
    "frame, field, remedy",
    [
        (Frame(images=dict.fromkeys(["left", "right"], IMAGE)), "points", "stereo"),
        (Frame(points=DRIVE[0].points), "left", "cloud"),
    ],
)
def test_a_frame_without_what_the_source_needs_names_a_source_that_does_not(
    frame: Frame, field: str, remedy: str
) -> None:
    with pytest.raises(
        DataError, match=f"source='{remedy}'", check=has_code("missing-sensor", field)
    ):
        LoopDetector("m2dp").add(frame)


def test_the_remedy_for_scans_without_images_works() -> None:
    detector = LoopDetector("m2dp", fusion=FusionConfig(source="cloud"))
    assert detector.add(Frame(points=DRIVE[0].points)) is None and len(detector) == 1


def test_the_preset_in_a_name_decides_whether_z_must_point_up() -> None:
    sections = DescriptorConfig(), FusionConfig(source="cloud", up="-y"), RegistrationConfig()
    FrameObserver({"m2dp": "m2dp"}, *sections)
    with refuses("not-up", error=ConfigError):
        FrameObserver({"m2dp:upright": "m2dp:upright"}, *sections)
