# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""A robot on a map of nine keyframes along a street, whose true poses are known."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from clouds import scan_blocks
from fusionslam.base.arrays import Matrix
from fusionslam.loop_closure import LoopConfig, Observation, verification
from fusionslam.loop_closure.contract import NOTHING, Rule
from fusionslam.loop_closure.verification import StoredFrame
from fusionslam.mapping import localization
from fusionslam.mapping.localization import (
    Localization,
    LocalizationConfig,
    Localizer,
)
from fusionslam.registration import PreparedCloud
from rows import rows
from streets import assert_near, at

pytest.importorskip("gtsam", reason="the libraries of registration are an extra")


def seen_at(pose: Matrix, seed: int) -> PreparedCloud:
    return PreparedCloud(scan_blocks(pose, seed))


WAY = [at(4.0 * step, 0, 0) for step in range(-4, 5)]
CLOUDS = [seen_at(pose, seed) for seed, pose in enumerate(WAY)]
EVERY = dict.fromkeys(range(len(WAY)), 0.1)


class Street:
    """The map; asks of each keyframe are counted."""

    def __init__(self, keyframes: Sequence[int] = range(len(WAY))) -> None:
        self.known = list(keyframes)
        self.asked: list[int] = []
        self.parts: dict[int, int] = {}

    def stored(self, number: int) -> StoredFrame:
        def unpack() -> PreparedCloud:
            self.asked.append(number)
            return CLOUDS[number]

        return StoredFrame(0, None, CLOUDS[number].search_image, unpack)

    def pose(self, number: int) -> Matrix:
        return WAY[number]

    def part(self, number: int) -> int:
        return self.parts.get(number, 0)

    def near(self, place: Matrix, radius: float, keyframe: int) -> list[int]:
        apart = {k: float(np.linalg.norm(WAY[k][:3, 3] - place[:3, 3])) for k in self.known}
        return [k for k in sorted(apart, key=apart.__getitem__) if apart[k] <= radius]


def localizer_of(street: Any, config: LocalizationConfig | None = None) -> Localizer:
    return Localizer(street, street.stored, config=config)


def sight(
    cloud: PreparedCloud,
    candidates: Mapping[int, float],
    odometry: Matrix | None = None,
    stamp_ns: int | None = None,
) -> tuple[Observation, Mapping[int, float]]:
    return Observation({}, stamp_ns, cloud, odometry), candidates


def assert_at(found: Localization, truth: Matrix) -> None:
    assert found.reason is None and found.pose is not None and found.covariance is not None
    assert_near(found.pose, truth, 0.1, 0.5)


@rows("truth", [at(1.0, 0.5, 10), at(-7.0, 1.5, 180), at(9.0, -1.0, -95)])
def test_a_robot_is_found_without_a_guess_in_any_direction(truth: Matrix) -> None:
    assert_at(localizer_of(Street()).localize(*sight(seen_at(truth, 50), EVERY)), truth)


def test_another_place_has_no_pose_but_a_reason() -> None:
    points = scan_blocks(at(1.0, 0.5, 10), 50, place=13)
    found = localizer_of(Street()).localize(*sight(PreparedCloud(points), EVERY))
    assert found.pose is None and found.covariance is None
    assert found.reason is not None and found.reason.code


@rows("probability, code", [(0.7, "improbable"), (0.95, None)])
def test_neighbors_that_agree_on_an_improbable_pose_do_not_make_it_right(
    monkeypatch: pytest.MonkeyPatch, probability: float, code: str | None
) -> None:
    for name in ("register", "verify_candidates"):
        monkeypatch.setattr(localization, name, _weighed(name, probability))
    found = localizer_of(Street()).localize(*sight(seen_at(at(1.0, 0.5, 10), 50), EVERY))
    assert (found.reason and found.reason.code) == code
    assert (found.pose is None) == (code is not None)


def _weighed(name: str, probability: float) -> Callable[..., Any]:
    """Registration whose results are all of one probability."""
    original = getattr(localization, name)

    def run(*arguments: Any, **options: Any) -> Any:
        found = original(*arguments, **options)
        if name == "register":
            return replace(found, probability=probability)
        return replace(found[0], probability=probability), *found[1:]

    return run


def test_a_place_that_is_like_no_keyframe_has_no_candidates() -> None:
    found = localizer_of(Street()).localize(*sight(seen_at(WAY[0], 50), {}))
    assert found.pose is None and found.keyframe is None
    assert found.reason is not None and found.reason.code == "no-candidates"


def test_one_keyframe_alone_is_believed_once_odometry_confirms_it() -> None:
    way = [at(0.5 * step, 0.5, 0) for step in range(4)]
    localizer = localizer_of(Street([4]))
    found = [
        localizer.localize(*sight(seen_at(pose, 60 + k), {4: 0.1}, pose, k * 10**9))
        for k, pose in enumerate(way)
    ]
    assert found[0].reason is not None and found[0].reason.code == "alone"
    assert found[0].keyframe == 4
    for pose, each in zip(way[1:], found[1:], strict=True):
        assert_at(each, pose)


def test_poses_of_another_part_of_the_map_confirm_nothing() -> None:
    street = Street([4])
    localizer = localizer_of(street)
    for k in range(3):
        street.parts[4] = k
        found = localizer.localize(*sight(seen_at(WAY[4], 60 + k), {4: 0.1}, WAY[4], k * 10**9))
        assert found.reason is not None and found.reason.code == "alone"
        assert found.part is None


def test_odometry_that_contradicts_confirms_nothing() -> None:
    localizer = localizer_of(Street([4]))
    for k in range(3):
        wrong = at(3.0 * k, 0, 0)  # the robot stands still
        found = localizer.localize(*sight(seen_at(WAY[4], 60 + k), {4: 0.1}, wrong, k * 10**9))
        assert found.reason is not None and found.reason.code == "alone"


def test_poses_of_long_ago_confirm_nothing() -> None:
    localizer = localizer_of(Street([4]), config=LocalizationConfig(memory=5.0))
    for k in range(3):
        seen = sight(seen_at(WAY[4], 60 + k), {4: 0.1}, WAY[4], 6 * k * 10**9)
        reason = localizer.localize(*seen).reason
        assert reason is not None and reason.code == "alone"


def test_a_tracked_robot_needs_no_candidates() -> None:
    street = Street()
    localizer = localizer_of(street)
    assert_at(localizer.localize(*sight(seen_at(WAY[0], 50), EVERY, WAY[0], 0)), WAY[0])
    drifted = WAY[1] @ at(0.3, 0.2, 1.0) @ np.linalg.inv(at(0, 0, 0))
    found = localizer.localize(*sight(seen_at(WAY[1], 51), {}, drifted, 10**9))
    assert_at(found, WAY[1])


def test_a_robot_is_lost_after_metres_in_which_it_was_not_found() -> None:
    street = Street()
    localizer = Localizer(street, street.stored, lost_after=10.0)
    elsewhere = PreparedCloud(scan_blocks(at(0, 0, 0), 60, place=13))
    ways = [at(4.0 * step, 3.0, 0) for step in range(5)]  # of odometry
    lost = [localizer.localize(*sight(elsewhere, EVERY, way, 0)) for way in ways]
    assert [each.unconfirmed_m for each in lost] == pytest.approx([0, 4, 8, 12, 16])
    assert [each.is_lost for each in lost] == [False, False, False, True, True]
    assert lost[0].deviation_m is None
    found = localizer.localize(*sight(seen_at(WAY[3], 61), EVERY, ways[-1], 0))
    assert found.unconfirmed_m == 0 and not found.is_lost and found.covariance is not None
    assert found.deviation_m == pytest.approx(np.sqrt(np.trace(found.covariance[:3, :3])))
    again = localizer.localize(*sight(elsewhere, EVERY, ways[-1] @ at(3.0, 0, 0, 4.0), 0))
    assert again.unconfirmed_m == pytest.approx(5.0) and not again.is_lost
    blind = localizer.localize(*sight(elsewhere, EVERY))  # without odometry
    assert blind.is_lost and blind.unconfirmed_m is None


def test_a_robot_that_was_carried_is_found_again() -> None:
    localizer = localizer_of(Street())
    assert_at(localizer.localize(*sight(seen_at(WAY[0], 50), EVERY, WAY[0], 0)), WAY[0])
    # Odometry, switched off meanwhile, says that it has not moved.
    truth = at(12.0, 1.0, 90)
    found = localizer.localize(*sight(seen_at(truth, 51), EVERY, WAY[0], 10**9))
    assert_at(found, truth)


def test_a_robot_whose_odometry_began_anew_is_found_again() -> None:
    localizer = localizer_of(Street())
    localizer.localize(*sight(seen_at(WAY[0], 50), EVERY, WAY[0], 0))
    localizer.forget()
    found = localizer.localize(*sight(seen_at(WAY[8], 51), EVERY, np.eye(4), 10**9))
    assert_at(found, WAY[8])


def test_poses_are_as_probable_as_the_rate_of_false_ones_asks(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rule = Rule(0.9, 0.95)
    for module in (localization, verification):
        monkeypatch.setattr(module, "rule_of", lambda cloud, rate: rule)
    street = Street()
    localizer = Localizer(street, street.stored, LoopConfig(false_rate=0.01))
    assert_at(localizer.localize(*sight(seen_at(WAY[0], 50), EVERY, WAY[0], 0)), WAY[0])
    assert_at(localizer.localize(*sight(seen_at(WAY[1], 51), {}, WAY[1], 10**9)), WAY[1])
    rule = NOTHING
    found = localizer.localize(*sight(seen_at(WAY[2], 52), EVERY, WAY[2], 2 * 10**9))
    assert found.pose is None and found.reason is not None and found.keyframe is not None
    assert found.reason.code == "not-promised"
