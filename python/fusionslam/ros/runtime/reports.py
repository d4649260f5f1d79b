# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Tells by the reports of nodes on /diagnostics whether they have processed everything."""

from collections import Counter
from collections.abc import Collection
from typing import Any

REPORTS = "/diagnostics"
_SAME_REPORTS = 3
"""So many reports of each node since the last change of any: what one sent reached the next."""
_OWN_TIME = ("processor time", "latency")
"""Values of a report that change even if nothing happens."""
_OF_MESSAGES = ("received ", "dropped ", "refused ")
"""Values of a report that count messages, not results."""
_IDLE = ("idle", "yes")
LISTENS_TO = "listens to"
"""Value of a report that holds full names of topics."""


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
