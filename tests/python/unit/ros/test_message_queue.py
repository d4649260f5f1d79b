# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The message queue is bounded, takes one publisher, and counts dropped messages."""

import logging
import random
import threading
from pathlib import Path
from typing import Any

import pytest

from fusionslam.errors import ConfigError, DataError
from fusionslam.ros.runtime.checkpoints import Saver, SavingConfig
from fusionslam.ros.runtime.config import CommonConfig, from_parameters
from fusionslam.ros.runtime.message_queue import SECOND_PUBLISHER, TOO_MANY, Arrival, MessageQueue
from fusionslam.ros.runtime.problem_log import ProblemLog
from ros_node import causes
from rows import rows

ONE = "/driver"


def drain(queue: MessageQueue) -> list[Any]:
    found = []
    while arrival := queue.get(0.0):
        found.append(arrival.message)
    return found


def test_messages_of_all_topics_come_out_in_the_order_in_which_they_came() -> None:
    queue = MessageQueue(limit=9, only_one_s=2.0)
    for number in range(9):
        queue.put(Arrival("abc"[number % 3], number, 0.0), ONE)
    assert drain(queue) == list(range(9))


@rows("seed", range(60))
def test_a_burst_keeps_the_newest_and_counts_the_rest(seed: int) -> None:
    rng = random.Random(seed)
    limit, topics = rng.randint(1, 7), rng.choices("abc", k=rng.randint(0, 60))
    pauses = rng.sample(range(60), rng.randint(0, 60))
    queue, out = MessageQueue(limit, 2.0), 0
    lists: dict[str, list[int]] = {name: [] for name in "abc"}
    lost = dict.fromkeys("abc", 0)
    for number, topic in enumerate(topics):
        dropped = queue.put(Arrival(topic, number, 0.0), ONE)
        lists[topic].append(number)
        assert dropped == (TOO_MANY if len(lists[topic]) > limit else None)
        if dropped:
            lost[topic] += 1
            lists[topic].pop(0)
        if number in pauses:
            first = min(each[0] for each in lists.values() if each)
            arrival = queue.get(0.0)
            assert arrival is not None and arrival.message == first
            lists[arrival.topic].pop(0)
            out += 1
    assert {name: queue.dropped[name, TOO_MANY] for name in "abc"} == lost
    rest = drain(queue)
    assert rest == sorted(number for each in lists.values() for number in each)
    assert sum(queue.taken.values()) == len(topics) == out + len(rest) + sum(lost.values())


def test_a_second_publisher_is_heard_only_when_the_first_was_silent() -> None:
    queue = MessageQueue(limit=9, only_one_s=2.0)
    assert queue.put(Arrival("scan", "a", 0.0), "/one") is None
    assert queue.put(Arrival("scan", "b", 1.9), "/two") == SECOND_PUBLISHER
    assert queue.put(Arrival("scan", "c", 2.0), "/one") is None
    assert queue.put(Arrival("scan", "d", 4.0), "/two") == SECOND_PUBLISHER
    assert queue.put(Arrival("scan", "e", 4.1), "/two") is None
    assert queue.put(Arrival("scan", "f", 4.2), "/one") == SECOND_PUBLISHER
    assert drain(queue) == ["a", "c", "e"] and queue.publisher_of("scan") == "/two"
    assert queue.dropped == {("scan", SECOND_PUBLISHER): 3}


def test_after_a_driver_is_gone_the_next_one_is_heard_at_once() -> None:
    there = {"/one", "/two"}
    queue = MessageQueue(9, 2.0, is_there=lambda topic, publisher: publisher in there)
    queue.put(Arrival("scan", "a", 0.0), "/one")
    there.remove("/one")
    assert queue.put(Arrival("scan", "b", 0.1), "/two") is None
    assert drain(queue) == ["a", "b"] and not queue.dropped


def test_topics_that_many_publish_on_hear_all() -> None:
    queue = MessageQueue(9, 2.0)
    for number in range(90):
        assert queue.put(Arrival("/tf", number, 0.0), None, is_many=True) is None
    assert queue.put(Arrival("/tf", 90, 0.0), None, is_many=True) == TOO_MANY
    assert drain(queue) == list(range(1, 91))


def test_many_threads_lose_and_double_nothing() -> None:
    queue, count, problems = MessageQueue(10_000, 2.0), 500, ProblemLog()

    def work(name: str) -> None:
        for number in range(count):
            queue.put(Arrival(name, (name, number), 0.0), ONE)
            problems.add("scan", f"{number} is wrong", "wrong")
            assert sum(problems.counts.values()) and sum(queue.taken.values())

    threads = [threading.Thread(target=work, args=(name,)) for name in "abcd"]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    found = drain(queue)
    assert sorted(found) == [(name, number) for name in "abcd" for number in range(count)]
    (((topic, _), total),) = problems.counts.items()
    assert (topic, total) == ("scan", 4 * count)


def test_a_cause_is_logged_once_however_its_message_varies(
    caplog: pytest.LogCaptureFixture,
) -> None:
    problems = ProblemLog()
    news = [problems.add("scan", f"{k} of 5\nmore", "few", "points") for k in range(1, 6)]
    assert news == [True, False, False, False, False] and len(caplog.messages) == 1
    assert problems.counts == {("scan", "1 of 5"): 5}
    assert problems.add("image", "1 of 5", "few", "points")
    assert problems.add("scan", "1 of 5", "few", "colours")


def test_causes_made_of_chance_fill_neither_memory_nor_the_log(
    caplog: pytest.LogCaptureFixture,
) -> None:
    problems = ProblemLog()
    for number in range(2000):
        problems.add("scan", "wrong", str(number))
    problems.add("image", "wrong", "code")
    assert list(problems.counts.values()) == [30, 1970, 1]
    assert len(caplog.messages) == 31


@rows(
    "given, name",
    [
        ({"nodes": {"queue": 1}}, "~nodes"),
        ({"node": {"queu": 1}}, "~node/queu"),
        ({"node": {"queue": 0}}, "~node/queue"),
        ({"node": {"queue": "many"}}, "~node/queue"),
        ({"node": 3}, "~node"),
        ({"node": {"stamps": "now"}}, "~node/stamps"),
    ],
)
def test_a_wrong_parameter_is_refused_with_the_name_that_ros_has(
    given: dict[str, Any], name: str
) -> None:
    with pytest.raises(ConfigError, match=rf"{name}\b") as error:
        from_parameters(CommonConfig(), given)
    assert "\n" not in str(error.value)


class Memory:
    """Something to keep; writing it may fail."""

    def __init__(self, path: Path, every: float = 1e-9) -> None:
        self.text, self.problems, self.broken = "", ProblemLog(), False
        self.saver = Saver(SavingConfig(file=str(path), every=every), self._save, self.problems)

    def _save(self, path: Path) -> None:
        if self.broken:
            raise DataError(f"cannot write {path}: No space left on device")
        path.write_text(self.text)


def test_a_failed_write_is_tried_again(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    memory = Memory(tmp_path / "map")
    for memory.text, memory.broken in [("a", False), ("b", True), ("c", True)]:
        memory.saver.note_change()
    assert (tmp_path / "map").read_text() == "a"
    assert causes(caplog) == ["cannot-write"]
    assert list(memory.problems.counts.values()) == [2]
    memory.broken = False
    memory.saver.close()
    assert (tmp_path / "map").read_text() == "c"


def test_changes_lost_at_the_end_are_logged(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    memory = Memory(tmp_path / "map", every=1e9)
    memory.broken = True
    memory.saver.note_change()
    memory.saver.close()
    assert caplog.records[-1].levelno == logging.ERROR and causes(caplog)[-1] == "lost"


def test_ten_times_as_many_small_messages_may_wait() -> None:
    queue = MessageQueue(limit=3, only_one_s=1.0)
    lost = [queue.put(Arrival("odom", k, 0.0, 0), "/base", is_many=True) for k in range(31)]
    assert lost == [None] * 30 + [TOO_MANY]
    first = queue.get(0.0)
    assert first is not None and first.message == 1


@rows("folder", ["/proc/none", "file"])
def test_a_folder_that_cannot_be_written_is_logged_at_the_start(
    folder: str, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "file").write_text("")
    memory = Memory(tmp_path / folder / "map")
    assert causes(caplog) == ["cannot-write"]
    assert sum(memory.problems.counts.values()) == 1


def test_without_changes_nothing_is_written(tmp_path: Path) -> None:
    Memory(tmp_path / "map").saver.close()
    assert not list(tmp_path.iterdir())
