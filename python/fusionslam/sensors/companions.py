# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Messages of further sensors that frames take along: images of cameras, scans of scanners."""

from bisect import bisect_right, insort
from collections import Counter
from collections.abc import Collection, Iterable
from typing import Generic, TypeVar

from fusionslam.sensors.messages import NANOSECONDS, Picture, Scan, as_nanoseconds
from fusionslam.sensors.synchronizer import SyncConfig, choose_image

M = TypeVar("M", Picture, Scan)


class Companions(Generic[M]):
    """The newest messages of further sensors, one of which belongs to each frame.

    Which one is decided as by ``Synchronizer``. A sensor that has been silent for longer than
    ``wait`` is waited for no more until its next message.

    Args:
        names: of the sensors.
        config: policy and limits.
        wait: how long a silent sensor is waited for, in seconds of stamps.

    Attributes:
        missing: frames that lack a message, by sensor.
    """

    def __init__(self, names: Iterable[str], config: SyncConfig, wait: float) -> None:
        self.names = tuple(names)
        self.missing: Counter[str] = Counter()
        self._config = config
        self._wait_ns = wait * NANOSECONDS
        self._reach_ns = as_nanoseconds("max_difference", config.max_difference)
        self._lateness_ns = as_nanoseconds("lateness", config.lateness)
        self._first_ns: int | None = None
        self._unplaced: set[str] = set()
        self._messages: dict[str, list[tuple[int, M]]] = {name: [] for name in self.names}

    def add(self, name: str, message: M) -> None:
        """Keep a message; of more than ``buffer`` the oldest is dropped."""
        kept = self._messages[name]
        if kept and kept[-1][0] - message.stamp_ns > self._config.jump * NANOSECONDS:
            kept.clear()
        insort(kept, (message.stamp_ns, message), key=lambda each: each[0])
        del kept[: -self._config.buffer]

    def is_settled(self, stamp_ns: int, newest_ns: int) -> bool:
        """Whether no better message for a scan is expected.

        Args:
            stamp_ns: of the scan.
            newest_ns: newest stamp of all sensors.
        """
        self._first_ns = stamp_ns if self._first_ns is None else min(self._first_ns, stamp_ns)
        for name, kept in self._messages.items():
            last_ns = kept[-1][0] if kept else self._first_ns
            chosen = self._chosen(name, stamp_ns)
            ahead = self._reach_ns if chosen is None else abs(chosen.stamp_ns - stamp_ns)
            is_silent = newest_ns - last_ns > self._wait_ns
            if is_silent or (chosen is not None and ahead == 0):
                continue
            if self._config.policy == "last_before":
                ahead = 0
            elif chosen is not None:
                ahead -= 1  # one that is as near is no better
            if not kept or last_ns <= stamp_ns + ahead + self._lateness_ns:
                return False
        return True

    def choose(self, stamp_ns: int) -> dict[str, M]:
        """The messages of a scan by sensor, without the sensors that have none."""
        found = {name: self._chosen(name, stamp_ns) for name in self.names}
        return {name: message for name, message in found.items() if message is not None}

    def newest(self, name: str) -> int | None:
        """Newest stamp of a sensor; None while it is silent."""
        return self._messages[name][-1][0] if self._messages[name] else None

    def count(self, stamp_ns: int, held: Collection[str], placed: Collection[str]) -> None:
        """Count what a finished frame lacks; drop what later ones cannot take.

        Args:
            stamp_ns: of its scan.
            held: the sensors of which it has a message.
            placed: those of them whose place on the robot is known.
        """
        self.missing.update(name for name in self.names if name not in held)
        self._unplaced |= {name for name in self.names if name in held}
        self._unplaced -= {*placed}
        for kept in self._messages.values():
            before = bisect_right(kept, stamp_ns, key=lambda each: each[0])
            del kept[: max(before - 1, 0)]

    @property
    def awaited(self) -> set[str]:
        """Sensors whose place is worth waiting for: it was known, or has not been asked for."""
        return {*self.names} - self._unplaced

    def forget(self) -> None:
        """Drop all messages after the clock jumped back."""
        self._first_ns = None
        for kept in self._messages.values():
            kept.clear()

    def _chosen(self, name: str, stamp_ns: int) -> M | None:
        kept = self._messages[name]
        stamps = [each[0] for each in kept]
        row = choose_image(stamps, stamp_ns, self._config.policy, self._reach_ns)
        return None if row is None else kept[row][1]
