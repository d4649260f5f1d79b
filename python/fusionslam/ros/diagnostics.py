# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What a node says of itself on /diagnostics: counts, latencies, processor time."""

import time
from collections import deque
from typing import TYPE_CHECKING, Any

import numpy as np

from fusionslam.ros.message_types import DIAGNOSTICS, header, make

if TYPE_CHECKING:
    from fusionslam.ros.shell import Shell

_KEPT = 1000
_OK, _WARN = 0, 1


class Stopwatch:
    """How long messages took that something was published of: from arrival until it was done."""

    def __init__(self) -> None:
        self._seconds: deque[float] = deque(maxlen=_KEPT)

    def note(self, seconds: float) -> None:
        """Of one message."""
        self._seconds.append(seconds)

    def quantile_ms(self, share: float) -> float | None:
        """Milliseconds that this share of the last 1,000 did not exceed; None before the first."""
        return 1e3 * float(np.quantile(self._seconds, share)) if self._seconds else None


def diagnostics(shell: "Shell") -> Any:
    """A DiagnosticArray of a node as it is now."""
    import rospy

    values = dict(_values(shell))
    trouble = sum(shell.complaints.counts.values()) + sum(shell.inbox.dropped.values())
    worst = shell.complaints.counts.most_common(1)
    status = make(
        "diagnostic_msgs/DiagnosticStatus",
        level=_WARN if trouble else _OK,
        name=f"fusionslam: {shell.name}",
        message=f"{worst[0][0][0]}: {worst[0][0][1]}" if worst else "fine",
        hardware_id=rospy.get_name(),
        values=[make("diagnostic_msgs/KeyValue", key=key, value=values[key]) for key in values],
    )
    now = rospy.Time.now().to_nsec()
    return make(DIAGNOSTICS, header=header(now, ""), status=[status])


def _values(shell: "Shell") -> Any:
    for topic in shell.inputs:
        yield f"received {topic}", str(shell.inbox.taken[topic])
    for (topic, reason), count in sorted(shell.inbox.dropped.items()):
        yield f"dropped {topic}: {reason}", str(count)
    for what, count in shell.node.report().items():
        yield what, str(count)
    for (topic, cause), count in sorted(shell.complaints.counts.items()):
        yield f"refused {topic}: {cause}", str(count)
    for share in (0.5, 0.95):
        milliseconds = shell.watch.quantile_ms(share)
        if milliseconds is not None:
            yield f"latency p{100 * share:.0f} [ms]", f"{milliseconds:.2f}"
    yield "processor time [s]", f"{time.process_time():.2f}"
