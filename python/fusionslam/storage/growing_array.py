# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Tables that grow by rows."""

from typing import Any

import numpy as np
from numpy.typing import NDArray


class Rows:
    """An array that grows at its end, at a cost that does not depend on its length.

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
        """Every row: a view, which the next row may leave behind."""
        return self._stored[: self._count]

    def append(self, row: Any) -> None:
        """Add a row."""
        if self._count == len(self._stored):
            self._stored = np.concatenate([self._stored, np.zeros_like(self._stored)])
        self._stored[self._count] = row
        self._count += 1

    @classmethod
    def of(cls, rows: NDArray[Any]) -> "Rows":
        """With these rows, which are copied."""
        made = cls(rows.dtype.type, rows.shape[1] if rows.ndim == 2 else 0)
        made._stored = np.concatenate([rows, made._stored])
        made._count = len(rows)
        return made
