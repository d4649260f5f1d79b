# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Two-stage comparison of views: the second stage verifies the matches of the first."""

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from fusionslam.errors import ConfigError, DataError, ShapeError
from fusionslam.sensors.frame import Cloud
from fusionslam.views.comparison import Arrays, Candidate, Comparison, Item, View
from fusionslam.views.scenes import Scene

TWO_STAGES = "two_stage."
"""Prefix of the kind of a two-stage comparison; the kind of the first stage follows."""


class SecondStage(Protocol):
    """Verifies matches, such as the network of ``fusionslam.views.second_stage``.

    Attributes:
        digest: identifies the features; only features of the same digest are comparable.
    """

    digest: str

    def features(self, cloud: Cloud) -> NDArray[np.float32]:
        """The features to store for a cloud, float32 (F,)."""

    def probability(self, current: NDArray[np.float32], stored: NDArray[np.float32]) -> float:
        """Probability that two clouds show the same place, in [0, 1]."""


class TwoStageComparison:
    """A second stage that can only reject matches of the first one (Stastny 2022, 4.7).

    Candidates are checked in the order of the first stage. A candidate that the second stage
    rejects gets similarity 0 and never matches; then the next one is checked.

    Args:
        first: compares all stored views.
        second: verifies the best of them.
        threshold: the lowest probability that the second stage accepts.
        start: the first stage's similarity from which the second one checks; None for the
            threshold of the first, so that every match has to pass both.
        most: the most candidates that the second stage checks.

    Raises:
        ConfigError: a value out of range.
    """

    def __init__(
        self,
        first: Comparison,
        second: SecondStage,
        *,
        threshold: float,
        start: float | None = None,
        most: int = 10,
    ) -> None:
        self.default_threshold = first.default_threshold
        start = first.default_threshold if start is None else start
        for name, value in (("threshold", threshold), ("start", start)):
            if not 0 <= value <= 1:
                raise ConfigError(f"second stage: {name} is {value}, expected 0 to 1")
        if most < 1:
            raise ConfigError(f"second stage: most is {most}, expected at least 1")
        self._first, self._second = first, second
        self._needed, self._start, self._most = threshold, start, most
        self._features: list[NDArray[np.float32]] = []
        self.kind = TWO_STAGES + first.kind

    def __len__(self) -> int:
        return len(self._features)

    def settings(self) -> dict[str, Any]:
        return {**self._first.settings(), "second_stage": self._second.digest}

    def view(self, item: Item) -> View:
        """The view of a cloud for both stages."""
        if not isinstance(item, Cloud):
            raise ShapeError(f"two stages need a Cloud, got {type(item).__name__}")
        first = self._first.view(item)
        features = self._second.features(item) if first.objects else None
        return View((first, features), first.objects)

    def scene(self, view: View) -> Scene | None:
        return self._first.scene(view.content[0])

    def arrays_of(self, view: View) -> dict[str, NDArray[Any]]:
        """The arrays of the first stage and the features, float32 (F,); (0,) if there are none."""
        first, features = view.content
        row = np.empty(0, np.float32) if features is None else features
        return {**self._first.arrays_of(first), "features": row}

    def view_of(self, arrays: Arrays) -> View:
        first, features = self._first.view_of(arrays), arrays["features"]
        if not first.objects:
            if features.size:
                raise DataError(f"features {features.shape} of nothing to recognise, expected (0,)")
            return View((first, None), 0)
        self._check_features(features)
        return View((first, features), first.objects)

    def compare(self, view: View, most: int) -> list[Candidate]:
        """The first stage's best candidates that the second one accepts, then the rejected ones."""
        first, features = view.content
        passed, rejected = [], []
        for candidate in self._first.compare(first, max(self._most, most)):
            is_accepted = candidate.similarity < self._start or (
                self._second.probability(features, self._features[candidate.slot]) >= self._needed
            )
            if not is_accepted:
                rejected.append(Candidate(candidate.slot, 0.0, rejected=True))
            else:
                passed.append(candidate)
            if len(passed) == most:
                break
        return [*passed, *rejected][:most]

    def add(self, view: View) -> int:
        """Store the view for both stages. Raises DataError for a view without objects."""
        first, features = view.content
        if features is None:
            raise DataError("two stages compare scans with objects: min_objects must be at least 1")
        self._features.append(np.asarray(features, np.float32))
        return self._first.add(first) + int(self._features[-1].nbytes)

    def remove(self, slot: int) -> None:
        self._first.remove(slot)
        del self._features[slot]

    def size_of(self, slot: int) -> int:
        return self._first.size_of(slot) + int(self._features[slot].nbytes)

    def explain(self, similarity: float, threshold: float) -> str:
        return self._first.explain(similarity, threshold)

    def state(self) -> dict[str, NDArray[Any]]:
        return {**self._first.state(), "features": np.array(self._features, np.float32)}

    def restore(self, state: Arrays) -> None:
        self._first.restore(state)
        features = np.asarray(state["features"], np.float32)
        if len(features) != len(self._first):
            raise DataError(f"{len(features)} rows of features for {len(self._first)} views")
        for row in features[:1]:  # all have the same length
            self._check_features(row)
        if not np.isfinite(features).all():
            raise DataError("the features are not finite", code="not-finite")
        self._features = list(features)

    def _check_features(self, row: NDArray[np.float32]) -> None:
        """Raise DataError or ShapeError for features that this network cannot have computed."""
        if row.dtype != np.float32 or row.ndim != 1:
            raise DataError(f"features are {row.dtype} {row.shape}, expected float32 (F,)")
        if not np.isfinite(row).all():
            raise DataError("the features are not finite", code="not-finite")
        self._second.probability(row, row)  # raises for another network's length
