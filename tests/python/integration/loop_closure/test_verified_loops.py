# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Loops proven by registration: true poses of made places, reasons, files, bad input."""

import pickle
import threading
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

from clouds import scan_blocks
from fusionslam import (
    Cloud,
    ConfigError,
    DataError,
    FusionConfig,
    FusionSlamError,
    Loop,
    LoopConfig,
    LoopDetector,
)
from fusionslam.base.arrays import Matrix
from fusionslam.loop_closure import detector as detector_module
from fusionslam.loop_closure import verification
from fusionslam.loop_closure.contract import NOTHING, Rule
from fusionslam.loop_closure.verification import SequenceGate
from fusionslam.registration import Refusal, Registration, RegistrationConfig
from fusionslam.sensors.frame import Frame
from rows import rows
from streets import WAY, assert_near, at
from worlds import AHEAD, room, scan, seen_from

PLANAR = RegistrationConfig(method="planar")
DRIVE = [Cloud(scan_blocks(pose, seed, 15_000)) for seed, pose in enumerate(WAY[:16])]


class Driven(NamedTuple):
    """A detector that was driven over the way, its loops, and itself after twelve frames."""

    detector: LoopDetector
    loops: list[Loop | None]
    halfway: bytes


def drive(detector: LoopDetector, first: int = 0, last: int = len(DRIVE)) -> list[Loop | None]:
    return [detector.add(DRIVE[k], stamp_ns=10 * k, odometry=WAY[k]) for k in range(first, last)]


def new_detector(**options: object) -> LoopDetector:
    return LoopDetector("m2dp", window=3, **options)


@pytest.fixture(scope="module")
def driven() -> Driven:
    detector = new_detector()
    loops = drive(detector, 0, 12)
    halfway = pickle.dumps(detector)
    return Driven(detector, loops + drive(detector, 12), halfway)


def test_places_are_found_in_the_opposite_direction_with_their_poses(driven: Driven) -> None:
    detector, loops, _ = driven
    assert detector.verifies
    assert loops[:9] == [None] * 9  # a street that is driven for the first time
    found = [loop for loop in loops[11:] if loop is not None]
    assert len(found) == 5
    for loop in found:
        truth = np.linalg.inv(WAY[loop.match]) @ WAY[loop.query]
        assert_near(loop.match_from_query, truth, 0.1, 0.5)
        assert np.linalg.norm(loop.match_from_query[:3, 3]) <= detector.config.max_distance
        assert loop.covariance.shape == (6, 6) and loop.overlap > 0.6
        assert loop.probability >= 0.95


def test_without_gravity_the_nearest_candidates_are_searched_thoroughly(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    thorough: list[bool] = []

    def no_pose(*_: Any, **options: Any) -> Registration:
        thorough.append(options["thorough"])
        return Registration(None, None, reason=Refusal("no-match", 0, ""))

    monkeypatch.setattr(verification, "register", no_pose)
    free = RegistrationConfig(gravity=False)
    detector = new_detector(registration=free, config=LoopConfig(refined=2))
    drive(detector, 0, 9)
    assert thorough[-5:] == [True, True, False, False, False]


def test_the_nearest_and_the_rejected_are_known_of_the_last_frame() -> None:
    detector = new_detector()
    drive(detector, 0, 8)
    assert detector.nearest.reason and detector.nearest.match_from_query is not None
    matches = [match for match, _, _, _ in detector.rejected]
    assert matches[0] == detector.nearest.match
    assert sorted(matches) == [0, 1, 2, 3]
    for _, code, number, text in detector.rejected:
        assert code and text and np.isfinite(number)


def test_what_is_farther_than_a_place_is_wide_is_no_loop() -> None:
    detector = LoopDetector("m2dp", window=0, config=LoopConfig(max_distance=0.5))
    drive(detector, 6, 10)  # the last one is where the one before was, turned around
    far = next(each for each in detector.rejected if each.code == "far")
    truth = np.linalg.inv(WAY[6 + far.match]) @ WAY[9]
    assert far.number == pytest.approx(np.linalg.norm(truth[:3, 3]), abs=0.1)


def test_loops_of_robots_on_a_floor_are_aligned() -> None:
    there, back = (0.2, -0.3, 0.5), (0.4, -0.2, 0.6)
    clouds = [
        scan(room(0), there, AHEAD, seed=0),
        scan(room(1), (0.0, 0.0, 3.0), AHEAD, seed=1),
        scan(room(2), (0.5, 0.5, 1.0), AHEAD, seed=2),
        scan(room(0), back, AHEAD, seed=0),
    ]
    detector = LoopDetector("cm2dp", window=1, registration=PLANAR)
    *first, loop = [detector.add(cloud) for cloud in clouds]
    assert first == [None] * 3
    assert (loop.query, loop.match) == (3, 0)
    x, y, yaw = seen_from(there, back)
    np.testing.assert_allclose(loop.match_from_query[:2, 3], [x, y], atol=0.03)
    assert np.arctan2(*loop.match_from_query[[1, 0], 0]) == pytest.approx(yaw, abs=0.03)
    with pytest.raises(DataError, match="colours"):
        detector.add(replace(clouds[0], colors=None))
    assert len(detector) == 4


def test_a_stored_detector_goes_on_as_if_it_had_never_stopped(
    tmp_path: Path, driven: Driven
) -> None:
    halfway = pickle.loads(driven.halfway)
    halfway.save(tmp_path)
    for again in (LoopDetector.load(tmp_path), halfway):
        rest = drive(again, 12)
        assert rest == driven.loops[12:]
        for one, other in zip(rest, driven.loops[12:], strict=True):
            if one is not None:
                np.testing.assert_array_equal(one.match_from_query, other.match_from_query)
        assert again.rejected == driven.detector.rejected
    begun = new_detector()
    drive(begun, 0, 1)
    assert drive(pickle.loads(pickle.dumps(begun)), 1, 4) == driven.loops[1:4]


def test_submitted_and_observed_frames_give_the_same_loops() -> None:
    added, behind, apart = (LoopDetector("m2dp", window=1) for _ in range(3))
    clouds = [DRIVE[k] for k in (1, 4, 7, 10, 13)]
    loops = [added.add(cloud) for cloud in clouds]
    assert any(loops)
    assert [behind.submit(cloud).result() for cloud in clouds] == loops
    assert behind.unverified == 0
    seen = [pickle.loads(pickle.dumps(apart.observe(cloud))) for cloud in clouds]
    assert [apart.add_observation(each) for each in seen] == loops


def test_a_loop_of_a_scan_that_was_taken_in_a_turn_is_less_certain(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(detector_module, "_SCANS_UNTIL_WARNING", 4)
    detector = new_detector(fusion=FusionConfig(source="cloud"))
    for k, cloud in enumerate(DRIVE[row] for row in (5, 6, 7, 8, 12)):
        loop = detector.add(
            Frame(
                points=cloud.points,
                stamp_ns=(k + 1) * 10**8,
                point_seconds=np.linspace(0, 0.1, len(cloud)),
                odometry=at(0.1 * k, 0, 6 * (k == 4), 0),  # turns at last
            )
        )
    assert loop is not None and loop.match == 0
    variance = np.degrees(np.degrees(np.asarray(loop.covariance)[5, 5]))
    floor = detector.registration_config.angle_sd**2
    np.testing.assert_allclose(variance - floor, 6**2 / 3, rtol=1e-3)
    said = [each.args for each in caplog.records if each.module == "scan_motion"]
    assert said == [("the recording", pytest.approx(0), pytest.approx(6), 1.0, 1, 4)]


def test_excluded_frames_are_no_candidates_and_leave_room_for_others() -> None:
    detector = LoopDetector("m2dp", window=0, candidates=2)
    for k, cloud in enumerate(DRIVE[:9]):
        detector.add_observation(detector.observe(cloud), excluded=range(k))
        assert detector.nearest is None and not detector.rejected
    seen = detector.observe(DRIVE[9])  # at the place of frame 8, turned around
    detector.add_observation(seen, excluded=[8])
    tried = {match for match, *_ in detector.rejected}
    assert len(tried | {detector.nearest.match}) >= 2 and 8 not in tried


def test_answers_stay_recent_when_frames_come_too_fast(monkeypatch: pytest.MonkeyPatch) -> None:
    detector, release, begun = new_detector(), threading.Event(), threading.Event()
    verify = LoopDetector._verify

    def slowly(self: LoopDetector, pending: Any) -> Loop | None:
        begun.set()
        assert release.wait(300)
        return verify(self, pending)

    monkeypatch.setattr(LoopDetector, "_verify", slowly)
    waiting = [detector.submit(DRIVE[0])]
    assert begun.wait(300)
    waiting += [detector.submit(cloud) for cloud in DRIVE[1:]]
    release.set()
    found = [each.result() for each in waiting]
    assert len(detector) == len(DRIVE)  # all are stored, and can be matched
    assert detector.unverified == len(DRIVE) - 1 - 3  # all but the first and the last three
    assert found[-1] is not None


def test_clouds_are_forgotten_with_their_frames() -> None:
    detector = new_detector(max_frames=8, candidates=1)
    loops = [loop for loop in drive(detector) if loop is not None]
    assert len(detector) == len(DRIVE) and len(detector.frames) < 8
    assert loops
    assert [loop.match_stamp_ns for loop in loops] == [10 * loop.match for loop in loops]


def test_errors_of_submitted_frames_are_those_of_their_futures() -> None:
    detector = new_detector()
    bad = detector.submit(Cloud(np.zeros((0, 3), np.float32)))
    good = detector.submit(DRIVE[0])
    with pytest.raises(DataError):
        bad.result()
    assert good.result() is None and len(detector) == 1


def test_another_limit_of_frames_counts_at_once() -> None:
    detector = new_detector(candidates=1)
    drive(detector, 0, 9)
    detector.limit_frames(8)
    drive(detector, 9, 10)
    assert len(detector.frames) < 10


def test_rooms_are_still_fitted_after_an_empty_detector_was_pickled() -> None:
    small = [Cloud(np.float32(0.2) * each.points) for each in DRIVE[:2]]
    detector = pickle.loads(pickle.dumps(new_detector()))
    detector.add(small[0])
    assert detector.registration_config.voxel < 0.3
    again = pickle.loads(pickle.dumps(detector))
    again.add(small[1])
    assert again.registration_config == detector.registration_config


def test_descriptors_alone_are_not_verified(driven: Driven) -> None:
    with pytest.raises(ConfigError, match="verify=False"):
        driven.detector.add_descriptor(np.ones(192, np.float32))
    plain = new_detector()
    plain.add_descriptor(np.ones(192, np.float32))
    assert not plain.verifies


def test_a_threshold_or_a_missing_extra_means_loops_are_not_verified(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    assert not new_detector(threshold=0.1).verifies
    assert new_detector(threshold=0.1, verify=True).verifies
    monkeypatch.setattr("fusionslam.loop_closure.observation.find_spec", lambda _: None)
    free = RegistrationConfig(gravity=False)
    assert not new_detector(registration=free).verifies
    assert "fusionslam[map]" in caplog.text
    with pytest.raises(FusionSlamError, match=r"fusionslam\[map\]"):
        new_detector(registration=free, verify=True)
    assert new_detector(registration=PLANAR).verifies and new_detector().verifies


def test_clouds_that_cannot_be_registered_leave_no_trace_or_a_reason() -> None:
    detector = new_detector()
    drive(detector, 0, 5)
    with pytest.raises(DataError):
        detector.add(Cloud(DRIVE[0].points[:0]))
    assert len(detector) == 5
    few = Cloud(DRIVE[0].points[:: len(DRIVE[0].points) // 30])
    assert detector.add(few) is None and detector.rejected


def loop_of(query: int, match: int, pose: Matrix, probability: float) -> Loop:
    reason = Refusal("improbable", probability, "") if probability < 0.95 else None
    return Loop(query, match, 0.1, pose, np.eye(6), 0.6, probability, reason)


def test_two_loops_of_four_frames_that_agree_count() -> None:
    gate = SequenceGate(LoopConfig())
    matches = [at(2 * k, 0, 0) for k in range(6)]
    queries = [at(2 * k, 1, 0) for k in range(6)]  # as odometry has them, which drifted
    shift = np.linalg.inv(matches[0]) @ at(0, 0.4, 0)

    def judge(k: int, probability: float, off: float = 0.0) -> Loop | None:
        pose = shift.copy()
        pose[0, 3] += off
        return gate.judge(loop_of(100 + k, k, pose, probability), queries[k], matches[k])

    assert judge(0, 0.92).reason.code == "alone"
    assert judge(1, 0.92, off=5).reason is not None and judge(2, 0.92).reason is None
    assert judge(3, 0.4).reason.code == "improbable"


@rows(
    "stretches, counts",
    [([(1, 0), (1, 0)], True), ([(1, 0), (2, 0)], False), ([(1, 0), (1, 3)], False)],
)
def test_loops_of_different_stretches_of_odometry_do_not_confirm_each_other(
    stretches: list[tuple[int, int]], counts: bool
) -> None:
    gate = SequenceGate(LoopConfig())
    for k, between in enumerate(stretches):
        pose = at(2 * k, 0, 0)
        judged = gate.judge(loop_of(100 + k, k, np.eye(4), 0.92), pose, pose, between)
    assert (judged.reason is None) == counts


def test_a_pose_that_was_refused_is_not_supported() -> None:
    gate = SequenceGate(LoopConfig())
    refused = replace(loop_of(9, 1, np.eye(4), 0.92), covariance=None)
    for _ in range(3):
        assert gate.judge(refused, np.eye(4), np.eye(4)).reason is not None


def test_a_loop_without_odometry_stands_alone() -> None:
    gate = SequenceGate(LoopConfig())
    for _ in range(3):
        assert gate.judge(loop_of(9, 1, np.eye(4), 0.7), None, None).reason.code == "improbable"
    assert gate.judge(loop_of(9, 1, np.eye(4), 0.99), None, None).reason is None


def test_loops_count_if_they_are_as_probable_as_the_rate_of_false_ones_asks(
    driven: Driven, monkeypatch: pytest.MonkeyPatch
) -> None:
    rule = Rule(0.9, 0.95)
    monkeypatch.setattr(verification, "rule_of", lambda cloud, rate: rule)
    detector = new_detector(config=LoopConfig(false_rate=0.05))
    assert drive(detector, 0, 13) == driven.loops[:13]
    rule = NOTHING
    assert drive(detector, 13) == [None] * 3
    assert detector.nearest.match_from_query is not None
    assert detector.nearest.reason.code == "not-promised"
    assert "not-promised" in {each.code for each in detector.rejected}


def test_neighbors_do_not_make_up_for_a_promise() -> None:
    gate = SequenceGate(LoopConfig())
    for k in range(4):
        pose = at(2 * k, 0, 0)
        loop = loop_of(100 + k, k, np.eye(4), 0.97)
        refused = replace(loop, reason=Refusal("not-promised", 0.97, ""))
        assert gate.judge(loop, pose, pose).reason is None
        assert gate.judge(refused, pose, pose).reason.code == "not-promised"
