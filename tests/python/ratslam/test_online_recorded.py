# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Recordings whose messages arrive one by one give the steps of ``run_ratslam``."""

from pathlib import Path
from typing import NamedTuple

import pytest

from fusionslam.geometry.odometry_noise import DRIFT
from fusionslam.pipelines.map_events import events_of, motions_of
from fusionslam.pipelines.maps import run_ratslam
from fusionslam.pipelines.tours import open_tour
from fusionslam.ratslam import GivenView, Look, MatcherSource, OnlineRatSlam, Step
from fusionslam.ratslam.view_sources import build_view_source
from map_arrivals import Message, all_of, arrived
from recorded_drives import write_drive


class Recorded(NamedTuple):
    """What a run did, and the messages of a robot that recognises the views by itself."""

    steps: list[Step]
    odometry: list[Message]
    looks: list[Message]


def recorded(source: Path, views: str) -> Recorded:
    steps: list[Step] = []
    run_ratslam(source, views, watch=lambda step, *_: steps.append(step))
    tour, matcher = open_tour(source), build_view_source(views)
    assert isinstance(matcher, MatcherSource)
    events = events_of(tour, matcher)
    looks: list[Message] = []
    for index, stamp_ns in enumerate(events.look_stamps_ns.tolist()):
        stored = len(matcher.matcher)
        seen = matcher.look(events.item(index), stamp_ns)
        is_new = seen.view_id >= stored
        values = (seen.relative_rotation, seen.relative_place, seen.reason)
        looks.append(Look(stamp_ns, GivenView(seen.view_id, is_new, *values)))
    return Recorded(steps, [*motions_of(tour, None, DRIFT)[1]], looks)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    return recorded(write_drive(tmp_path_factory.mktemp("drive") / "drive.npz"), "objects")


@pytest.fixture(scope="module")
def house(test_data: Path) -> Recorded:
    return recorded(test_data / "bags" / "small_house_20s.bag", "objects")


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("lag_s", [0.02, 0.1, 0.5])
@pytest.mark.parametrize("name", ["made", "house"])
def test_whatever_arrives_first_the_steps_are_those_of_the_recording(
    name: str, seed: int, lag_s: float, request: pytest.FixtureRequest
) -> None:
    drive: Recorded = request.getfixturevalue(name)
    online = OnlineRatSlam()
    messages = arrived(drive.odometry, drive.looks, seed, lag_s=lag_s, jitter_s=0.3)
    steps = all_of(online, messages)
    assert len(drive.steps) > 500
    assert steps[: len(drive.steps)] == drive.steps
    assert not online.refused and online.jumps == online.views.restarts == 0


@pytest.mark.parametrize("name", ["made", "house"])
def test_after_the_last_view_there_is_odometry_alone(
    name: str, request: pytest.FixtureRequest
) -> None:
    drive: Recorded = request.getfixturevalue(name)
    online = OnlineRatSlam()
    rest = all_of(online, arrived(drive.odometry, drive.looks, 0))[len(drive.steps) :]
    assert not any(step.looked for step in rest)
