# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What a robot that drives in a circle senses, for live views."""

from collections.abc import Iterator

import numpy as np

from fusionslam.ratslam import Motion, Sighting
from fusionslam.ratslam.events import Event

MS = 1_000_000
START = 1_700_000_000_123_456_789
"""Stamps as clocks have them."""


def circle(seconds: float = 6.0) -> Iterator[Event]:
    """At 30 Hz, every view in it seen anew each half second, twice round."""
    for k in range(round(seconds * 30)):
        stamp = START + k * 33 * MS
        yield Motion(stamp, 0.5, 2 * np.pi / 3)
        if k % 15 == 0:
            yield Sighting(stamp, (k // 15) % 6)
