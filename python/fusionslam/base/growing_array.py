# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Arrays that grow row by row."""

from typing import Any

import numpy as np
from numpy.typing import NDArray


class Rows:
    """An array to which rows are appended in amortised constant time.

    Args:
        dtype: of the numbers.
        width: numbers in a row; 0 for single numbers.
    """

    def __init__(self, dtype: type[Any], width: int = 0) -> None:
        self._stored: NDArray[Any] = np.zeros((4, width) if width else 4, dtype)
        self._count = 0

    def __len__(self) -> int:
        return self._count

    @property
    def all(self) -> NDArray[Any]:
        """All rows, as a view that may be out of date after the next ``append``."""
        return self._stored[: self._count]

    def append(self, row: Any) -> None:
        """Append a row."""
        if self._count == len(self._stored):
            self._stored = np.concatenate([self._stored, np.zeros_like(self._stored)])
        self._stored[self._count] = row
        self._count += 1

    @classmethod
    def of(cls, rows: NDArray[Any]) -> "Rows":
        """Make a table from a copy of these rows."""
        made = cls(rows.dtype.type, rows.shape[1] if rows.ndim == 2 else 0)
        made._stored = np.concatenate([rows, made._stored])
        made._count = len(rows)
        return made
