# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""A map that is killed, clocks that go back or on, and views that start anew: the map goes on."""

import logging
from dataclasses import replace
from itertools import cycle
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from drives import (
    SECOND,
    Message,
    circles,
    everything,
    later,
    looks_of,
    odometry,
    on_map,
    order_by_arrival,
    process_all,
    process_and_flush,
    same,
    sightings,
)
from fusionslam.errors import DataError
from fusionslam.ratslam import (
    ActionKind,
    GivenView,
    Look,
    OnlineRatSlam,
    RatSlam,
    Step,
    TemplateSource,
)
from fusionslam.ratslam.online import TOO_LATE
from fusionslam.sensors.messages import Odometry
from rows import rows

START = 1000
# Messages of odometry before the last one before the first view.
UNUSED = 3


def messages(laps: float, seed: int = 0, **delays: Any) -> list[Message]:
    way = circles(laps)
    moves, views = later(odometry(way), START), later(looks_of(sightings(way)), START)
    return order_by_arrival(moves, views, seed, **delays)


def truth(laps: float, stamps_ns: Any) -> Any:
    """float64 (n, 3): where the robot was at stamps."""
    return np.stack(circles(laps).places(np.array(stamps_ns) / 1e9 - START), axis=1)


def apart(one: Any, other: Any) -> Any:
    return np.linalg.norm(np.asarray(one)[:, :2] - np.asarray(other)[:, :2], axis=1)


def split(stream: list[Message]) -> tuple[list[Message], list[Look]]:
    """Odometry and looks."""
    looks = [one for one in stream if isinstance(one, Look)]
    return [one for one in stream if not isinstance(one, Look)], looks


def moment(one: Message) -> tuple[int, bool]:
    return one.stamp_ns, isinstance(one, Look)


def reload(online: OnlineRatSlam, folder: Path) -> OnlineRatSlam:
    online.save(folder / "map.npz")
    return OnlineRatSlam.load(folder / "map.npz")


def test_a_map_that_is_saved_and_loaded_goes_on_as_if_nothing_had_been(tmp_path: Path) -> None:
    stream, whole = messages(1.3), OnlineRatSlam()
    expected = process_and_flush(whole, stream)
    stream.sort(key=moment)
    for flushed in (True, False):
        online, steps, at = OnlineRatSlam(), list[Step](), 0
        for _ in range(8):
            steps += process_all(online, stream[at : at + 97])
            steps += online.flush() if flushed else []
            # What still waits is not in the file, and is sent again.
            at = 1 + [moment(one) for one in stream].index((steps[-1].stamp_ns, steps[-1].looked))
            online = reload(online, tmp_path)
        steps += process_and_flush(online, stream[at:])
        assert at > 700 and steps == expected
        assert same(everything(online.slam), everything(whole.slam))


def test_a_map_that_is_killed_goes_on_from_its_last_file(tmp_path: Path) -> None:
    stream = messages(1.3)
    online = OnlineRatSlam()
    process_all(online, stream[:400])
    online.save(tmp_path / "map.npz")
    nodes = len(online.slam.map.nodes)
    process_all(online, stream[400:700])
    del online
    # Views that the killed one knew are unknown to the older map, and get numbers of their own.
    found = OnlineRatSlam.load(tmp_path / "map.npz")
    steps = process_and_flush(found, stream[700:])
    assert len(found.slam.map.nodes) > nodes and not found.refused and found.jumps == 0
    # The gap is noted, and poses tell how far the robot went meanwhile.
    assert steps[0].why
    was = truth(1.3, [step.stamp_ns for step in steps])
    assert apart([step.pose for step in steps], was).max() < 0.5


def test_a_recording_that_is_played_again_is_taken_as_a_clock_that_went_back(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    stream = messages(1.1)
    online = OnlineRatSlam()
    process_and_flush(online, stream)
    again = reload(online, tmp_path)
    with caplog.at_level(logging.WARNING):
        steps = process_and_flush(again, stream)
    assert again.jumps == 1 and not again.refused and len(steps) == len(stream)
    assert len(caplog.records) == 2  # the clock, and the views
    # The ids are new again: the matcher began anew, too.
    assert again.views.restarts == 1


def test_on_another_day_the_map_goes_on_where_the_robot_was_switched_off(tmp_path: Path) -> None:
    stream = messages(2.2)
    half = stream[len(stream) // 2].stamp_ns
    evening = [one for one in stream if one.stamp_ns < half]
    morning = [one for one in later(stream, 86_400) if one.stamp_ns >= half + 86_400 * SECOND]
    origin = next(one.pose for one in morning if isinstance(one, Odometry))
    online = OnlineRatSlam()
    process_and_flush(online, evening)
    again = reload(online, tmp_path)
    # Odometry begins anew.
    moved = [
        replace(one, pose=np.linalg.inv(origin) @ one.pose) if isinstance(one, Odometry) else one
        for one in morning
    ]
    steps = process_and_flush(again, moved)
    assert again.jumps == 0 and not again.refused and len(steps) == len(morning)
    assert again.views.restarts == 0
    # It knows every place, and makes few nodes more.
    nodes, before = len(again.slam.map.nodes), len(online.slam.map.nodes)
    assert nodes < 1.3 * before
    assert sum(step.action.kind == ActionKind.CREATE_EDGE for step in steps) > before / 3


@pytest.mark.slow
def test_a_recording_in_a_loop_gives_the_same_steps_whatever_the_delays() -> None:
    first = messages(1.1)
    plain = OnlineRatSlam()
    expected = [step for _ in range(3) for step in process_and_flush(plain, first)]
    # By when it arrives, on a clock that goes on; the stamps go back.
    length = first[-1].stamp_ns / 1e9 + 1
    times = [
        [later([one], k * length)[0] for k in range(3) for one in part] for part in split(first)
    ]
    for seed, lag_s in enumerate((0.0, 0.3, 1.7)):
        order = order_by_arrival(*times, seed, lag_s=lag_s, jitter_s=0.2)
        stamped = [cycle(part) for part in split(first)]
        online = OnlineRatSlam()
        steps = process_and_flush(online, [next(stamped[isinstance(one, Look)]) for one in order])
        assert online.jumps == 2 and not online.refused and len(steps) == 3 * len(first) - UNUSED
        assert steps == expected and same(on_map(online.slam), on_map(plain.slam))


def test_where_the_clock_goes_back_the_robot_is_where_odometry_says() -> None:
    online = OnlineRatSlam()
    stream = messages(0.5)
    before = {step.stamp_ns: step.dead_reckoning for step in process_and_flush(online, stream)}
    # The recording begins again: odometry, and the robot, are at their origin.
    known = [
        replace(one, item=replace(one.item, is_new=False)) if isinstance(one, Look) else one
        for one in stream
    ]
    steps = process_and_flush(online, known)
    assert steps[0].why
    after = [step for step in steps if step.stamp_ns in before]
    assert len(after) > 100
    for step in after:
        # Each small step leaves out how far odometry slid sideways.
        np.testing.assert_allclose(step.dead_reckoning, before[step.stamp_ns], atol=0.03)
    # So that it finds the places that it knows, and makes hardly any others.
    assert sum(step.action.kind == ActionKind.CREATE_NODE for step in after) < 3


def test_a_clock_that_goes_on_by_an_hour_is_a_gap() -> None:
    stream = messages(1.0, lag_s=0.5)
    half = stream[len(stream) // 2].stamp_ns
    moved = [one if one.stamp_ns < half else later([one], 3600)[0] for one in stream]
    online = OnlineRatSlam()
    steps = process_and_flush(online, moved)
    assert online.jumps == 0 and not online.refused and len(steps) == len(stream) - UNUSED
    after = next(step for step in steps if step.stamp_ns > half + 3000 * SECOND)
    assert after.why


def test_one_clock_that_goes_back_alone_does_not_stop_the_map() -> None:
    online = OnlineRatSlam()
    stream = messages(2.0)
    odometry_, looks = split(stream)
    # Views die, the simulation starts again, and they come back at a time when they had lived.
    early = [one for one in looks if one.stamp_ns < (START + 5) * SECOND]
    again = [one for one in looks if one.stamp_ns > (START + 8) * SECOND]
    first = order_by_arrival(
        [one for one in odometry_ if one.stamp_ns < (START + 20) * SECOND], early, 0
    )
    process_all(online, first)
    steps = process_and_flush(online, order_by_arrival(odometry_, again, 1))
    assert online.jumps == 1 and steps[-1].stamp_ns == stream[-1].stamp_ns
    seen = sum(step.looked for step in steps)
    assert seen + online.refused[TOO_LATE] == len(again) and seen > 0.8 * len(again)


def test_two_senders_whose_clocks_differ_stop_nothing_for_good() -> None:
    online = OnlineRatSlam()
    stream = messages(1.0)
    odometry_, looks = split(stream)
    wrong = later(odometry_, -100)
    both = [one for pair in zip(odometry_, wrong, strict=True) for one in pair]
    process_all(online, order_by_arrival(both[:120], looks[:6], 0)[:126])
    steps = process_and_flush(online, later(stream, 1000))
    assert steps[-1].stamp_ns == stream[-1].stamp_ns + 1000 * SECOND
    assert sum(step.looked for step in steps) > 0.8 * len(looks)


@rows("kept", [0, 10])
def test_a_matcher_that_starts_anew_gives_new_places(kept: int) -> None:
    way = circles(2.2)
    seen = sightings(way)
    half = len(seen) // 2
    # It comes back knowing only some views, and names the others as it meets them.
    names = {view: view for view in range(kept)}
    after = []
    for one in seen[half:]:
        is_new = one.view_id not in names
        name = names.setdefault(one.view_id, len(names))
        values = (one.relative_rotation, one.relative_place)
        after.append(Look(one.stamp_ns, GivenView(name, is_new, *values)))
    online = OnlineRatSlam()
    views = [*looks_of(seen[:half]), *after]
    steps = process_and_flush(
        online, order_by_arrival(later(odometry(way), START), later(views, START), 0)
    )
    assert not online.refused and online.views.restarts == 1
    assert max(step.view_id or 0 for step in steps) == 16 + 16 - kept - 1
    # No loop leads to a place that the id meant before.
    loops = [step for step in steps if step.action.kind == ActionKind.CREATE_EDGE]
    made_ns = np.array(online.slam.memory.node_stamps_ns)
    there = truth(2.2, [made_ns[step.action.target] for step in loops])
    assert loops and apart(truth(2.2, [step.stamp_ns for step in loops]), there).max() < 1.5


def test_a_map_that_starts_anew_takes_ids_from_the_middle() -> None:
    stream = messages(2.5)
    middle = len(stream) // 2
    online = OnlineRatSlam()
    steps = process_and_flush(online, stream[middle:])
    assert not online.refused and online.views.restarts == 16
    seen = [step.view_id for step in steps if step.looked]
    assert {*seen} == set(range(16)) and seen[0] == 0


def test_a_file_of_another_source_is_refused(tmp_path: Path) -> None:
    RatSlam().save(tmp_path / "none.npz")
    RatSlam(views=TemplateSource()).save(tmp_path / "images.npz")
    for name in ("none.npz", "images.npz", "missing.npz"):
        with pytest.raises(DataError, match=name):
            OnlineRatSlam.load(tmp_path / name)


def test_a_loaded_map_keeps_its_configuration_and_says_so(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    OnlineRatSlam(ratslam={"preset": "openratslam"}).save(tmp_path / "map.npz")
    OnlineRatSlam.load(tmp_path / "map.npz", ratslam={"preset": "openratslam"})
    assert not caplog.messages
    found = OnlineRatSlam.load(tmp_path / "map.npz", order={"wait": 5.0})
    assert len(caplog.messages) == 1
    assert found.config.ratslam.preset == found.slam.preset == "openratslam"
    assert found.config.order.wait == 5.0 and found.config.order.in_order


def test_a_map_that_never_began_is_saved_and_begins_when_loaded(tmp_path: Path) -> None:
    stream = messages(0.5)
    OnlineRatSlam().save(tmp_path / "map.npz")
    online = OnlineRatSlam.load(tmp_path / "map.npz")
    assert process_and_flush(online, stream) == process_and_flush(OnlineRatSlam(), stream)
