# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""View ids from programs without a sensor, which every method in a table must beat."""

import numpy as np
from numpy.typing import NDArray

from fusionslam.errors import ConfigError


def always_new(n: int) -> NDArray[np.int64]:
    """Ids int64 (n,) of a program that calls each of n scans a new view."""
    return every_kth(n, 1)


def every_kth(n: int, k: int) -> NDArray[np.int64]:
    """Ids int64 (n,) of a program that starts a new view with every k-th of n scans.

    Raises:
        ConfigError: n < 0 or k < 1.
    """
    if n < 0:
        raise ConfigError(f"n is {n}, expected at least 0 scans")
    if k < 1:
        raise ConfigError(f"k is {k}, expected a new view every 1 or more scans")
    return np.arange(n, dtype=np.int64) // k


def baselines(n: int) -> dict[str, NDArray[np.int64]]:
    """Return the ids int64 (n,) of the baselines that appear in every table, by name."""
    return {
        "always new": always_new(n),
        "new every 2nd": every_kth(n, 2),
        "new every 3rd": every_kth(n, 3),
    }
