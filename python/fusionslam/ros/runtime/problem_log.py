# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What goes wrong on a robot: counted always, said once for each cause."""

import logging
import re
import threading
from collections import Counter

logger = logging.getLogger(__name__)

# What differs from message to message: bytes, sizes, addresses in memory, numbers; not the digits
# of names, such as M2DP.
_VARYING = re.compile(r"""b'[^']*'|b"[^"]*"|0x[0-9a-f]+|\d+x\d+|(?<![A-Za-z\d])-?\d[\d.e+-]*""")
_CAUSES = 30
_MORE = "more causes than are told apart"


class Complaints:
    """Counts what was refused, and logs each cause once; from any thread.

    A cause is the first line of a problem, with "#" for its numbers. Of a topic, the first 30
    causes are told apart, so that content made of chance neither fills memory nor the log.
    """

    def __init__(self) -> None:
        self._counts: Counter[tuple[str, str]] = Counter()
        self._lock = threading.Lock()

    @property
    def counts(self) -> Counter[tuple[str, str]]:
        """By (topic, cause), as of now."""
        with self._lock:
            return self._counts.copy()

    def add(self, topic: str, problem: str) -> bool:
        """Note a problem with a message of a topic: what is wrong and what to do.

        Returns:
            Whether this cause is new.
        """
        is_new = self._count(topic, _VARYING.sub("#", problem.partition("\n")[0]))
        if is_new:
            # Not under the lock: what is logged is published.
            logger.warning("%s: %s (said once; /diagnostics counts on)", topic, problem)
        return is_new

    def _count(self, topic: str, cause: str) -> bool:
        with self._lock:
            known = (topic, cause) in self._counts
            if not known and sum(name == topic for name, _ in self._counts) >= _CAUSES:
                self._counts[topic, _MORE] += 1
                return False
            self._counts[topic, cause] += 1
            return not known
