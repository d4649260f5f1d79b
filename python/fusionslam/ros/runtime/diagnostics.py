# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Reports of a node on /diagnostics: counts, latencies, processor time."""

import time
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from fusionslam.ros.messages.library import make, message_class
from fusionslam.ros.messages.types import DIAGNOSTICS, header
from fusionslam.ros.runtime.reports import LISTENS_TO

if TYPE_CHECKING:
    from fusionslam.ros.runtime.worker import Worker


def diagnostics(worker: "Worker", node: str, now_ns: int) -> Any:
    """Return a DiagnosticArray of the current state of a node with this full name."""
    values = dict(list_values(worker))
    problems = [f"nothing has arrived on {entry.topic}" for entry in worker.silent]
    problems += [f"{t}: {cause}" for (t, cause), _ in worker.problems.counts.most_common(1)]
    level = message_class("diagnostic_msgs/DiagnosticStatus")
    status = make(
        "diagnostic_msgs/DiagnosticStatus",
        level=level.WARN if problems else level.OK,
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
