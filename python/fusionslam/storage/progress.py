# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The types of progress callbacks."""

from collections.abc import Callable

Progress = Callable[[int, int], None]
"""Called with the number of items done and the total."""

Step = Callable[[str, int, int], None]
"""Called with the name of a step, the number of items done and the total."""


def label_progress(step: Step | None, label: str) -> Progress:
    """Return a callback that reports to ``step`` under a name; without ``step`` it does nothing."""
    return (lambda done, total: None) if step is None else lambda *count: step(label, *count)
