# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Indexes that the tests of matching share."""

import numpy as np

from fusionslam import DescriptorIndex

SECOND = 1_000_000_000


def filled(count: int = 20, dimension: int = 7) -> DescriptorIndex:
    rng = np.random.default_rng(3)
    index = DescriptorIndex(dimension, window=2, window_seconds=1.5)
    for number in range(count):
        index.add(rng.normal(size=dimension).astype(np.float32), stamp_ns=number * SECOND)
    return index
