# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Compares views by one descriptor vector each."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fusionslam._core import DescriptorIndex
from fusionslam.descriptors import (
    DescriptorConfig,
    describe,
    find_descriptor,
    for_clouds,
    length_of,
    missing_data,
)
from fusionslam.descriptors.registry import SECTIONS
from fusionslam.errors import DataError, ShapeError
from fusionslam.fusion import ROBOT_FUSION
from fusionslam.sensors.frame import Cloud
from fusionslam.views.comparison import Arrays, Candidate, Item, View


class DescriptorComparison:
    """Compares descriptors by their distance d, as the similarity 1 / (1 + d).

    A cloud that cannot be described (too few points, or all on one line) gives a view without
    objects.

    Args:
        name: of the descriptor.
        config: the descriptor configuration.
        max_distance: the largest distance of a match.
    """

    def __init__(self, name: str, config: DescriptorConfig, max_distance: float) -> None:
        self._descriptor, self._config = find_descriptor(name), config
        self.kind = name
        self.default_threshold = similarity_at(max_distance)
        self._rows: list[NDArray[np.float32]] = []
        self._length = length_of(name, config)
        self._index = self._new_index()

    def __len__(self) -> int:
        return len(self._rows)

    def __getstate__(self) -> dict[str, Any]:
        return {k: v for k, v in vars(self).items() if k != "_index"} | {"_rows": [*self._rows]}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        self._fill(self._rows)

    def settings(self) -> dict[str, Any]:
        # Views of earlier versions have a section m2dp and no other that does not matter.
        others = {"threads"} | (set(SECTIONS) - {"m2dp", self._descriptor.section})
        values = self._config.model_dump(mode="json", exclude=others)
        if values["m2dp"]["axes"] is None:
            del values["m2dp"]["axes"]
        return {"descriptor": self._descriptor.name, "descriptors": values}

    def view(self, item: Item) -> View:
        """The view of a descriptor, float32 (D,), or of a cloud."""
        if isinstance(item, Cloud):
            return self._describe(item)
        if not isinstance(item, np.ndarray) or item.shape != (self._length,):
            found = f"shape {item.shape}" if isinstance(item, np.ndarray) else type(item).__name__
            raise ShapeError(
                f"expected a Cloud or a descriptor {self._descriptor.name}, float32 "
                f"({self._length},), got {found}"
            )
        if not np.isfinite(item).all():
            raise DataError("the descriptor is not finite", code="not-finite")
        return View(item.astype(np.float32), 1)

    def _describe(self, cloud: Cloud) -> View:
        name = self._descriptor.name
        if not np.isfinite(cloud.points).all():
            raise DataError(f"{name}: the cloud holds NaN or infinity", code="not-finite")
        if (problem := missing_data(cloud, name)) is not None:
            raise problem
        try:
            return View(describe(cloud, name, for_clouds(self._config, name, ROBOT_FUSION)), 1)
        except DataError:
            return View(None, 0)

    def scene(self, view: View) -> None:
        """None: a descriptor has no objects."""

    def arrays_of(self, view: View) -> dict[str, NDArray[Any]]:
        """The descriptor, float32 (D,); (0,) for a cloud that cannot be described."""
        return {"descriptor": np.empty(0, np.float32) if view.content is None else view.content}

    def view_of(self, arrays: Arrays) -> View:
        row = arrays["descriptor"]
        if row.dtype != np.float32:
            raise DataError(f"the descriptor is {row.dtype}, expected float32")
        return View(None, 0) if row.shape == (0,) else self.view(row)

    def compare(self, view: View, most: int) -> list[Candidate]:
        slots, distances = self._index.query(view.content, k=most)
        pairs = zip(slots.tolist(), distances.tolist(), strict=True)
        return [Candidate(slot, similarity_at(distance)) for slot, distance in pairs]

    def add(self, view: View) -> int:
        self._append(view.content)
        return int(view.content.nbytes)

    def remove(self, slot: int) -> None:
        self._fill([*self._rows[:slot], *self._rows[slot + 1 :]])

    def size_of(self, slot: int) -> int:
        return int(self._rows[slot].nbytes)

    def explain(self, similarity: float, threshold: float) -> str:
        """The comparison as text, in distances instead of similarities."""
        distance, most = distance_at(similarity), distance_at(threshold)
        return f"distance {distance:.4g} {'<=' if similarity >= threshold else '>'} {most:.4g}"

    def state(self) -> dict[str, NDArray[Any]]:
        return {"descriptors": np.array(self._rows, np.float32).reshape(len(self), self._length)}

    def restore(self, state: Arrays) -> None:
        rows = state["descriptors"]
        if rows.ndim != 2 or rows.shape[1] != self._length:
            raise DataError(f"descriptors {rows.shape}, expected (n, {self._length})")
        self._fill([np.asarray(row, np.float32) for row in rows])

    def _fill(self, rows: Sequence[NDArray[np.float32]]) -> None:
        self._rows, self._index = [], self._new_index()
        for row in rows:
            self._append(row)

    def _new_index(self) -> DescriptorIndex:
        return DescriptorIndex(self._length, metric=self._descriptor.metric)

    def _append(self, row: NDArray[np.float32]) -> None:
        self._index.add(row)
        self._rows.append(row)


def similarity_at(distance: float) -> float:
    """Convert a distance to a similarity."""
    return 1 / (1 + distance)


def distance_at(similarity: float) -> float:
    """Convert a similarity to a distance: infinity for 0."""
    return 1 / similarity - 1 if similarity > 0 else math.inf
