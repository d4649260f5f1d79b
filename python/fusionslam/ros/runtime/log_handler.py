# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Pass log records to a middleware."""

import logging
from collections.abc import Callable

from fusionslam.ros.runtime.problem_log import ProblemLog


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
