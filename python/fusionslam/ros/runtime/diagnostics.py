# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Reports of nodes on /diagnostics: counts, latencies, processor time; what they tell."""

import time
from collections import Counter
from collections.abc import Collection, Iterator, Mapping
from typing import TYPE_CHECKING, Any

from fusionslam.ros.messages.library import make, message_class
from fusionslam.ros.messages.types import DIAGNOSTICS, header

if TYPE_CHECKING:
    from fusionslam.ros.runtime.worker import Worker

REPORTS = "/diagnostics"
_SAME_REPORTS = 3
"""So many reports of each node since the last change of any: what one sent reached the next."""
_OWN_TIME = ("processor time", "latency")
"""Values of a report that change even if nothing happens."""
_REACHES = "subscriptions to "
_OF_MESSAGES = ("received ", "dropped ", "refused ", _REACHES)
"""Values of a report that count messages or connections, not results."""
_IDLE = ("idle", "yes")
LISTENS_TO = "listens to"
"""Value of a report that holds full names of topics."""


def diagnostics(worker: "Worker", node: str, now_ns: int, reached: Mapping[str, int]) -> Any:
    """Return a DiagnosticArray of the current state of a node.

    Args:
        worker: of the node.
        node: its full name.
        now_ns: time by the clock of the stamps.
        reached: number of subscriptions that its messages reach, by full names of topics.
    """
    values = dict(list_values(worker))
    values |= {f"{_REACHES}{topic}": str(count) for topic, count in reached.items()}
    problems = [f"nothing has arrived on {entry.topic}" for entry in worker.silent]
    problems += [f"{t}: {cause}" for (t, cause), _ in worker.problems.counts.most_common(1)]
    health, level = worker.node.health(), message_class("diagnostic_msgs/DiagnosticStatus")
    if health.level != "sure":
        problems.insert(0, health.text)
    status = make(
        "diagnostic_msgs/DiagnosticStatus",
        level=level.ERROR if health.level == "lost" else level.WARN if problems else level.OK,
        name=f"fusionslam: {worker.node.name}",
        message=problems[0] if problems else "fine",
        hardware_id=node,
        values=[make("diagnostic_msgs/KeyValue", key=key, value=values[key]) for key in values],
    )
    return make(DIAGNOSTICS, header=header(now_ns, ""), status=[status])


def list_values(worker: "Worker") -> Iterator[tuple[str, str]]:
    """Yield all counts and measurements as (label, value) pairs."""
    taken = worker.queue.taken
    yield LISTENS_TO, " ".join(worker.topics.values())
    for topic in worker.inputs:
        yield f"received {topic}", str(taken[topic])
    yield "waiting", str(worker.queue.waiting)
    yield "idle", "yes" if worker.is_idle else "no"
    for (topic, reason), count in sorted(worker.queue.dropped.items()):
        yield f"dropped {topic}: {reason}", str(count)
    for what, value in worker.node.report().items():
        yield what, str(value)
    for (topic, cause), count in sorted(worker.problems.counts.items()):
        yield f"refused {topic}: {cause}", str(count)
    for share in (0.5, 0.95):
        latency_s = worker.watch.quantile("latency", share)
        if latency_s is not None:
            yield f"latency p{100 * share:.0f} [ms]", f"{1e3 * latency_s:.2f}"
    yield "processor time [s]", f"{time.process_time():.2f}"


class NodeReports:
    """The latest reports of nodes, and how often each was repeated since any of them changed."""

    def __init__(self) -> None:
        self._last: dict[str, list[tuple[str, str]]] = {}
        self._repeats: Counter[str] = Counter()

    def take(self, message: Any) -> None:
        """Take a DiagnosticArray."""
        for status in message.status:
            values = [(e.key, e.value) for e in status.values if not e.key.startswith(_OWN_TIME)]
            if values == self._last.get(status.hardware_id):
                self._repeats[status.hardware_id] += 1
            else:
                self._last[status.hardware_id] = values
                self.forget()

    def topics(self, node: str) -> set[str] | None:
        """Full names of the topics that a node takes; None if it has not reported."""
        if node not in self._last:
            return None
        return set(dict(self._last[node]).get(LISTENS_TO, "").split())

    def reached(self, node: str) -> dict[str, int]:
        """Number of subscriptions that a node's messages reach, by full names of topics."""
        return {
            key.removeprefix(_REACHES): int(value)
            for key, value in self._last.get(node, ())
            if key.startswith(_REACHES)
        }

    def have(self, nodes: Collection[str]) -> bool:
        """Tell whether all nodes have reported."""
        return all(node in self._last for node in nodes)

    def are_quiet(self, nodes: Collection[str]) -> bool:
        """Tell whether all nodes are idle, and nothing has changed for some reports of each.

        A node that is held up reports nothing meanwhile, so it is waited for.
        """
        return all(
            _IDLE in self._last.get(node, ()) and self._repeats[node] >= _SAME_REPORTS
            for node in nodes
        )

    def forget(self) -> None:
        """Count from now on."""
        self._repeats.clear()

    def results(self) -> dict[str, list[str]]:
        """By node, what it made: the counts of its last report that are not of messages."""
        return {
            node: [
                f"{value} {key}"
                for key, value in values
                if value.isdigit() and value != "0" and not key.startswith(_OF_MESSAGES)
            ]
            for node, values in sorted(self._last.items())
        }
