# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Count problems, log each distinct cause once, and pass log records to a middleware."""

import logging
import threading
from collections import Counter
from collections.abc import Callable

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
        text = problem.partition("\n")[0]
        with self._lock:
            is_new = (topic, cause) not in self._counts
            counted = cause
            if is_new and sum(name == topic for name, _ in self._counts) >= _CAUSES:
                counted, text, is_new = (), _MORE, False
            self._counts[topic, counted] += 1
            self._texts.setdefault((topic, counted), text)
        if is_new:
            # Outside the lock, as logging publishes.
            words = "%s: %s (logged once; /diagnostics keeps counting)"
            logger.warning(words, topic, problem, extra={"topic": topic, "cause": cause})
        return is_new


class RosHandler(logging.Handler):
    """Passes log records to a middleware; warnings of the library only once for each cause.

    Args:
        say: logs a text at a level of ``logging``.

    Attributes:
        problems: the node's problem log, once there is a node.
    """

    def __init__(self, say: Callable[[int, str], None]) -> None:
        super().__init__(logging.INFO)
        self.problems: ProblemLog | None = None
        self._say = say

    def emit(self, record: logging.LogRecord) -> None:
        """Pass on a record."""
        is_problem = record.levelno >= logging.WARNING and self.problems is not None
        if is_problem and not record.name.startswith(str(__package__)):
            assert self.problems is not None
            # ``cause`` distinguishes problems that are logged with the same template.
            cause = getattr(record, "cause", (str(record.msg),))
            name = record.name.removeprefix("fusionslam.")
            self.problems.add(name, record.getMessage(), *cause)
            return
        self._say(record.levelno, self.format(record))
