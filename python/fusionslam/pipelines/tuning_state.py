# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The generations of a tuning, stored after each one so that the tuning can resume."""

import json
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fusionslam.errors import DataError
from fusionslam.storage.archive import load_archive, save_archive

FORMAT = "fusionslam.tuning.1"


@dataclass(frozen=True, eq=False)
class Generation:
    """Parameters that were tried, float64 (k, d), and their values, float64 (k,)."""

    numbers: NDArray[np.float64]
    values: NDArray[np.float64]


class TuningState:
    """The generations of a tuning, in a file or, without a path, in memory.

    Args:
        path: of the file, which need not exist.
    """

    def __init__(self, path: str | os.PathLike[str] | None = None) -> None:
        self.path = None if path is None else Path(path)
        self.generations: list[Generation] = []
        self._identity = ""

    def begin(self, identity: dict[str, Any]) -> None:
        """Load the generations in the file.

        Raises:
            DataError: the file is truncated, of another version, or of a tuning with other data
                or settings.
        """
        self._identity = json.dumps(identity, sort_keys=True)
        if self.path is None or not self.path.exists():
            return
        stored, self.generations = _read(self.path)
        if stored != self._identity:
            differing = _differences(json.loads(stored), identity)
            raise DataError(
                f"{self.path} belongs to a tuning with other {', '.join(differing)}: delete it, or "
                "write to another file",
                code="other-tuning",
                fields=differing,
            )

    def add(self, generation: Generation) -> None:
        """Store a generation. Raises DataError if the file cannot be written."""
        self.generations.append(generation)
        if self.path is None:
            return
        sizes = np.array([len(each.values) for each in self.generations], np.int64)
        arrays = {
            "sizes": sizes,
            "numbers": np.concatenate([each.numbers for each in self.generations]),
            "values": np.concatenate([each.values for each in self.generations]),
        }
        save_archive(self.path, FORMAT, {"identity": self._identity}, arrays)


def _read(path: Path) -> tuple[str, list[Generation]]:
    with load_archive(path, FORMAT, "the state of a tuning") as (about, stored):
        edges = np.cumsum(stored["sizes"])[:-1]
        parts = (np.split(stored[name], edges) for name in ("numbers", "values"))
        return str(about["identity"]), [Generation(*pair) for pair in zip(*parts, strict=True)]


def _differences(before: dict[str, Any], now: dict[str, Any]) -> list[str]:
    """Return the names of the differing values, such as "tuning.seed" and "sets"."""
    names = []
    for key, value in now.items():
        other = before.get(key)
        if isinstance(value, dict) and isinstance(other, dict):
            names += [f"{key}.{name}" for name in value if other.get(name) != value[name]]
        elif other != value:
            names.append(key)
    return names
