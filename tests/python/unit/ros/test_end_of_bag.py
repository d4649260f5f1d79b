# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""At the end of a bag nothing is lost, however slowly the last messages come through the nodes."""

import threading
import time
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, ClassVar

import pytest

from fusionslam.ratslam import GivenView, Look, Motion, StampOrder
from fusionslam.ros.messages.types import VIEW_DESCRIPTION
from fusionslam.ros.runtime import runner
from fusionslam.ros.runtime.config import CommonConfig
from fusionslam.ros.runtime.diagnostics import NodeReports
from fusionslam.ros.runtime.node import Delivery, Input, Node, Timer
from fusionslam.sensors.synchronizer import Synchronizer
from rows import rows

SECOND = 10**9


def move(seconds: float) -> Motion:
    return Motion(round(seconds * SECOND), 0.5, 0.0)


def view(seconds: float) -> Look:
    return Look(round(seconds * SECOND), GivenView(0, True))


def test_a_view_that_comes_after_a_silence_is_not_too_late() -> None:
    order = StampOrder(wait=2.0, in_order=True)
    begin, last = [move(0), move(1), view(1), move(2), move(3)], view(2.5)
    assert [one for event in begin for one in order.add(event)] == begin[:3]
    assert not order.settle()
    assert order.add(last) == [begin[3], last] and not order.too_late
    assert order.flush() == [begin[4]]


def test_a_silence_releases_the_views_that_wait_for_odometry() -> None:
    order, waiting = StampOrder(wait=9.0, in_order=True), [move(1), view(2), view(3)]
    assert [one for event in waiting for one in order.add(event)] == waiting[:1]
    assert order.settle() == waiting[1:]


@rows(
    "config, events, settles, why",
    [
        ({"wait": 9.0, "in_order": True}, [move(2), view(2)], False, "order"),
        ({"wait": 0.5}, [move(2), view(5)], False, "wait"),
        ({"wait": 0.5, "in_order": True}, [view(1), move(2), move(5), move(6)], False, "wait"),
        ({"wait": 9.0, "in_order": True}, [move(1), view(3)], True, "silence"),
        ({"wait": 9.0, "in_order": True}, [view(0), *map(move, range(1, 6))], False, "full"),
    ],
)
def test_what_is_too_late_says_what_it_was_too_late_for(
    config: dict[str, Any],
    events: list[Any],
    settles: bool,
    why: str,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("fusionslam.ratslam.event_order._MOST_WAITING", 4)
    order = StampOrder(**config)
    released = [one for event in events for one in order.add(event)]
    released += order.settle() if settles else []
    assert released
    order.add(move(released[-1].stamp_ns / SECOND - 0.5))
    assert (order.too_late, order.late_because) == (1, why)


def test_images_wait_through_a_silence_for_a_scan_that_is_late() -> None:
    sync = Synchronizer()
    assert not sync.add("points", SECOND, "scan") and not sync.add("left", SECOND + 5, "image")
    assert [pair.item for pair in sync.settle()] == ["scan"]
    assert not sync.add("left", 2 * SECOND, "next image") and not sync.settle()
    (pair,) = sync.add("points", 2 * SECOND, "late scan")
    assert pair.images["left"].item == "next image" and not sync.dropped
    assert not sync.flush() and sync.waiting == {"points": 0, "left": 0}


def report(node: str, **values: str) -> Any:
    pairs = [SimpleNamespace(key=key, value=value) for key, value in values.items()]
    return SimpleNamespace(status=[SimpleNamespace(hardware_id=node, values=pairs)])


def test_a_bag_is_over_once_no_node_has_changed_for_some_reports_of_each() -> None:
    reports, nodes = NodeReports(), ("/first", "/second")
    assert not reports.have(nodes) and not reports.are_quiet(nodes)

    def repeat(node: str, times: int = 4, **values: str) -> bool:
        for second in range(times):
            reports.take(report(node, **{"processor time [s]": str(second), **values}))
        return reports.are_quiet(nodes)

    repeat("/second", idle="yes", views="0")
    assert not repeat("/first", idle="no", clouds="7") and reports.have(nodes)
    # The second node is held up: it has not said anything since the first one sent it a cloud.
    assert not repeat("/first", 9, idle="yes", clouds="8")
    assert not repeat("/second", 2, idle="yes", views="0")
    assert not repeat("/second", idle="no", views="1")
    assert not repeat("/second", idle="yes", views="1")
    assert repeat("/first", 3, idle="yes", clouds="8")
    assert reports.results() == {"/first": ["8 clouds"], "/second": ["1 views"]}
    reports.forget()
    assert not reports.are_quiet(nodes)


def test_reports_say_which_topics_a_node_takes_and_whom_it_reaches() -> None:
    reports = NodeReports()
    assert reports.topics("/node") is None
    reports.take(report("/node", idle="yes"))
    assert reports.topics("/node") == set()
    reports.take(report("/node", **{"listens to": "/odom /robot/points"}))
    assert reports.topics("/node") == {"/odom", "/robot/points"} and not reports.reached("/node")
    reports.take(report("/node", **{"subscriptions to /cloud": "2", "clouds": "7"}))
    assert reports.reached("/node") == {"/cloud": 2}
    assert reports.results() == {"/node": ["7 clouds"]}


class Quiet(Node[CommonConfig]):
    """Counts its silences."""

    name = "quiet"
    defaults = CommonConfig()
    outputs: ClassVar = {}
    inputs = ()

    def idle(self) -> None:
        silences.append(self.name)


silences: list[str] = []


class Middleware:
    """Reports nothing, and does nothing of what it is asked for."""

    parameters: ClassVar = {"node": {"report": 1e9, "patience": 1e9}}

    def __getattr__(self, name: str) -> Any:
        return lambda *given, **named: 0


class HeldUp(Middleware):
    """A middleware on a machine that holds the node up for a minute before each look."""

    def __init__(self, messages: list[bool], monkeypatch: pytest.MonkeyPatch) -> None:
        def work(worker: Any, timeout_s: float) -> bool:
            worker.is_idle &= not messages[0]
            return messages.pop(0)

        self.seconds, self.messages = 0.0, messages
        monkeypatch.setattr(time, "monotonic", lambda: self.seconds)
        monkeypatch.setattr(runner.Worker, "work", work)

    def is_shut_down(self) -> bool:
        self.seconds += 60
        return not self.messages


@rows("looks, count", [(9, 0), (12, 1), (90, 1)])
def test_a_silence_is_what_a_node_waited_and_not_what_its_machine_held_it_up(
    looks: int, count: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    silences.clear()
    machine: Any = HeldUp([True, *[False] * looks], monkeypatch)
    runner.NodeRunner(Quiet, machine).run()
    assert len(silences) == count


class Beating(Quiet):
    """Beats until it is closed."""

    def __init__(self, config: CommonConfig, outlet: Any) -> None:
        super().__init__(config, outlet)
        self.closed, self.beats = False, list[bool]()
        nodes.append(self)

    @property
    def timers(self) -> list[Timer]:
        return [Timer("beat", 0.001, lambda now_ns: self.beats.append(self.closed))]

    def close(self) -> None:
        self.closed = True


nodes: list[Any] = []


class Ending(Middleware):
    """A middleware that shuts down once the node has beaten."""

    def is_shut_down(self) -> bool:
        return bool(nodes[-1].beats)


def test_nothing_beats_once_a_node_is_closed() -> None:
    machine: Any = Ending()
    runner.NodeRunner(Beating, machine).run()
    assert nodes[-1].closed and not any(nodes[-1].beats)
    assert "beat" not in [each.name for each in threading.enumerate()]


class Taking(Quiet):
    """Keeps what it takes until it is closed."""

    def __init__(self, config: CommonConfig, outlet: Any) -> None:
        super().__init__(config, outlet)
        self.taken, self.kept = list[Any](), list[Any]()
        nodes.append(self)

    @property
    def inputs(self) -> list[Input]:  # type: ignore[override]
        return [Input("numbers", [VIEW_DESCRIPTION], self.taken.append)]

    def close(self) -> None:
        self.kept = [each.header.stamp.sec for each in self.taken]


class Flooding(Middleware):
    """A middleware that shuts down with messages on their way, and goes on delivering them."""

    def subscribe(self, entry: Input, take: Callable[[Delivery], None], *, queue: int) -> None:
        def deliver(number: int) -> None:
            def read(*_: object) -> Any:
                deliver(number + 100)
                stamp = SimpleNamespace(sec=number, nanosec=0)
                return SimpleNamespace(header=SimpleNamespace(stamp=stamp))

            take(Delivery(VIEW_DESCRIPTION, "/somebody", 1, read))

        for number in (1, 2, 3):
            deliver(number)

    def is_shut_down(self) -> bool:
        return True


def test_what_waits_when_a_node_is_interrupted_is_taken_and_no_more() -> None:
    machine: Any = Flooding()
    runner.NodeRunner(Taking, machine).run()
    assert nodes[-1].kept == [1, 2, 3]
