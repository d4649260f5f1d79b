# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What goes wrong on a robot: counted always, said once for each cause."""

import logging
import re
from collections import Counter

logger = logging.getLogger(__name__)


class Complaints:
    """Counts what was refused, and logs each cause once.

    Attributes:
        counts: by (topic, cause); numbers in a cause are "#", as they differ every time.
    """

    def __init__(self) -> None:
        self.counts: Counter[tuple[str, str]] = Counter()

    def add(self, topic: str, problem: str) -> None:
        """Note a problem with a message of a topic: what is wrong and what to do."""
        cause = topic, re.sub(r"-?\d[\d.e+-]*", "#", problem)
        self.counts[cause] += 1
        if self.counts[cause] == 1:
            logger.warning("%s: %s (said once; /diagnostics counts on)", topic, problem)
