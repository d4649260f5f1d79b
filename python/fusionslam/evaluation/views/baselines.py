# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""View ids from programs without a sensor, which every method in a table must beat."""

import numpy as np
from numpy.typing import NDArray

from fusionslam.argument_types import checked
from fusionslam.errors import ConfigError

_MOST_SCANS = 10**8  # three years of ten a second


@checked
def always_new(n: int) -> NDArray[np.int64]:
    """Ids int64 (n,) of a program that calls each of n scans a new view.

    Raises:
        ConfigError: n is not 0 to 100 million.
    """
    return every_kth(n, 1)


@checked
def every_kth(n: int, k: int) -> NDArray[np.int64]:
    """Ids int64 (n,) of a program that starts a new view with every k-th of n scans.

    Raises:
        ConfigError: n is not 0 to 100 million, or k not 1 to 2**62.
    """
    if not 0 <= n <= _MOST_SCANS:
        raise ConfigError(f"n is {n}, expected 0 to {_MOST_SCANS} scans")
    if not 1 <= k <= 2**62:
        raise ConfigError(f"k is {k}, expected a new view every 1 to 2**62 scans")
    return np.arange(n, dtype=np.int64) // k


@checked
def baselines(n: int) -> dict[str, NDArray[np.int64]]:
    """Return the ids int64 (n,) of the baselines that appear in every table, by name."""
    return {
        "always new": always_new(n),
        "new every 2nd": every_kth(n, 2),
        "new every 3rd": every_kth(n, 3),
    }
