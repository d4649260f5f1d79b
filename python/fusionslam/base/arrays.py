# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Type aliases of arrays; shapes and units are documented where an array is used."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from fusionslam.errors import ShapeError

Floats = NDArray[np.float64]
Floats32 = NDArray[np.float32]
Integers = NDArray[np.int64]
Mask = NDArray[np.bool_]
Image = NDArray[np.uint8]
"""(H, W) grey or (H, W, 3) RGB."""
Points = NDArray[np.float32]
"""(N, 3), metres."""
Matrix = NDArray[np.float64]
"""A transform or a camera matrix: (3, 3), (3, 4) or (4, 4)."""


def read_numbers(name: str, values: Any, expected: str) -> Floats:
    """Return a copy of values as float64. Raises ShapeError that says what was expected."""
    try:
        with np.errstate(over="ignore"):
            return np.array(values, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise ShapeError(f"{name}: expected numbers {expected}; {error}") from error
