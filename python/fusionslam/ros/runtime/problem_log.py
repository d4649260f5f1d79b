# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Count problems, and log each distinct cause once."""

import logging
import threading
from collections import Counter

logger = logging.getLogger(__name__)

_CAUSES = 30
_MORE = "further causes (not listed)"


class ProblemLog:
    """Counts the problems of each topic and logs each cause once; thread-safe.

    Only the first 30 causes of a topic are listed, so that random content fills neither memory
    nor the log.
    """

    def __init__(self) -> None:
        self._counts: Counter[tuple[str, tuple[str, ...]]] = Counter()
        self._texts: dict[tuple[str, tuple[str, ...]], str] = {}
        self._lock = threading.Lock()

    @property
    def counts(self) -> Counter[tuple[str, str]]:
        """Current counts by (topic, first line of the first problem of a cause)."""
        counts: Counter[tuple[str, str]] = Counter()
        with self._lock:
            for (topic, cause), count in self._counts.items():
                counts[topic, self._texts[topic, cause]] += count
        return counts

    def add(self, topic: str, problem: str, *cause: str) -> bool:
        """Count a problem with a message of a topic.

        Args:
            problem: what is wrong and what to do.
            cause: a code, and fields that distinguish its causes; see ``errors.cause_of``.

        Returns:
            True if this cause is new.
        """
        is_new = self._count(topic, cause, problem.partition("\n")[0])
        if is_new:
            # Outside the lock, as logging publishes.
            words = "%s: %s (logged once; /diagnostics keeps counting)"
            logger.warning(words, topic, problem, extra={"topic": topic, "cause": cause})
        return is_new

    def _count(self, topic: str, cause: tuple[str, ...], text: str) -> bool:
        with self._lock:
            is_new = (topic, cause) not in self._counts
            if is_new and sum(name == topic for name, _ in self._counts) >= _CAUSES:
                cause, text, is_new = (), _MORE, False
            self._counts[topic, cause] += 1
            self._texts.setdefault((topic, cause), text)
            return is_new
