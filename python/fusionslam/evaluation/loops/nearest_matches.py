# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""``Matches``: the nearest earlier frames of each frame, and checks of their inputs."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fusionslam.base.argument_types import checked
from fusionslam.base.arrays import read_numbers
from fusionslam.errors import DataError, ShapeError
from fusionslam.geometry.rigid import is_rigid


@checked
@dataclass(frozen=True, eq=False)
class Matches:
    """The k nearest candidates of each of N queries, nearest first.

    Attributes:
        indices: int64 (N, k), rows of the candidates; -1 where there is none.
        distances: float32 (N, k), distances of the descriptors; inf where there is none. Of
            verified loops 1 - probability.
        match_from_query: float64 (N, k, 4, 4), the pose of the query's body in that of the
            candidate; NaN where it is not known. None of matches by descriptors alone.

    Raises:
        ShapeError: arrays of wrong or unequal shapes.
        DataError: a candidate without a finite distance, a distance without a candidate, or a pose
            without a candidate or that is no rotation and translation.
    """

    indices: NDArray[np.int64]
    distances: NDArray[np.float32]
    match_from_query: NDArray[np.float64] | None = None

    def __post_init__(self) -> None:
        shape = np.shape(self.indices)
        if len(shape) != 2 or shape[1] < 1 or shape != np.shape(self.distances):
            raise ShapeError(
                f"matches: indices {shape} and distances {np.shape(self.distances)}, "
                "expected two arrays (N, k) with k >= 1"
            )
        unsound = np.flatnonzero(((self.indices >= 0) != np.isfinite(self.distances)).any(axis=1))
        if unsound.size:
            raise DataError(
                f"matches: row {unsound[0]} has indices {self.indices[unsound[0]].tolist()} but "
                f"distances {self.distances[unsound[0]].tolist()}; expected -1 and inf together"
            )
        if self.match_from_query is not None:
            self._check_poses(self.match_from_query)

    def _check_poses(self, poses: NDArray[np.float64]) -> None:
        expected = (*np.shape(self.indices), 4, 4)
        if np.shape(poses) != expected:
            raise ShapeError(f"match_from_query: shape {np.shape(poses)}, expected {expected}")
        for row, column in np.argwhere(~np.isnan(poses).all(axis=(2, 3))).tolist():
            if self.indices[row, column] < 0 or not is_rigid(poses[row, column]):
                lack = "rotation and translation" if self.indices[row, column] >= 0 else "candidate"
                raise DataError(
                    f"match_from_query: row {row}, column {column} has the pose "
                    f"{poses[row, column].tolist()} but is no {lack}",
                    code="wrong-pose",
                    fields=("match_from_query", str(row), str(column)),
                )

    def __len__(self) -> int:
        return len(self.indices)


@checked
def find_matches(
    descriptors: NDArray[np.float32],
    *,
    window: int,
    k: int = 10,
    threads: int = 0,
    metric: str = "l2",
) -> Matches:
    """Find the k nearest candidates j <= i - window - 1 of each row i, by brute force.

    Args:
        descriptors: float32 (N, D), one row per frame, in order of time.
        window: number of frames before the query that are not candidates.
        k: number of candidates to keep.
        threads: number of threads; 0 is one per core.
        metric: how descriptors are compared, one of ``fusionslam.metric_names()``.

    Raises:
        ShapeError: wrong shape, or not real numbers.
        DataError: descriptors that are not finite.
        ConfigError: an unknown metric.
    """
    from fusionslam._core import nearest_causal

    rows = validate_descriptors(descriptors)
    return Matches(*nearest_causal(rows, window=window, k=k, threads=threads, metric=metric))


def match_described(rows: NDArray[np.float32], window: int, k: int, metric: str) -> Matches:
    """``find_matches`` among rows that are not zeros, which describe nothing but count in windows.

    Zeros have no candidates and are none: to metrics of sets they are a set of length zero.
    """
    from fusionslam._core import DescriptorIndex

    index, stored = DescriptorIndex(rows.shape[1], metric=metric), np.empty(0, np.int64)
    indices = np.full((len(rows), k), -1)
    distances = np.full((len(rows), k), np.inf, np.float32)
    for query, row in enumerate(rows):
        newest = query - window - 1
        if newest >= 0 and rows[newest].any():
            index.add(rows[newest])
            stored = np.append(stored, newest)
        if row.any():
            found, apart = index.query(row, k=k)
            indices[query, : len(found)], distances[query, : len(found)] = stored[found], apart
    return Matches(indices, distances)


def pairwise_distances(descriptors: NDArray[np.float32], metric: str = "l2") -> NDArray[np.float64]:
    """Return the distances of all pairs, float64 (N, N), of descriptors, float32 (N, D).

    Those of descriptors of zeros, which describe nothing, are NaN.
    """
    from fusionslam._core import nearest

    distances = np.full((len(descriptors), len(descriptors)), np.nan)
    described = np.flatnonzero(descriptors.any(axis=1))
    if len(described):
        rows = descriptors[described]
        others, found = nearest(rows, rows, k=len(rows), metric=metric)
        distances[described[:, None], described[others]] = found
    return distances


def metres_between(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """Euclidean distances of positions (..., 3)."""
    return np.asarray(np.sqrt(((a - b) ** 2).sum(axis=-1)), dtype=np.float64)


def validate_descriptors(descriptors: Any) -> NDArray[np.float32]:
    """Return descriptors as float32 (N, D), copying other real dtypes.

    Raises:
        ShapeError: wrong shape, or not real numbers.
        DataError: a descriptor that is not finite; the message names its row.
    """
    rows = np.asarray(descriptors)
    if rows.ndim != 2 or rows.shape[1] < 1 or rows.dtype.kind not in "fiu":
        raise ShapeError(f"descriptors: {rows.dtype} {rows.shape}, expected float32 (N, D)")
    with np.errstate(over="ignore"):
        rows = rows.astype(np.float32, copy=False)
    _check_finite("descriptors", rows)
    return rows


def validate_positions(positions: Any, count: int) -> NDArray[np.float64]:
    """Return positions as float64 (count, 3), metres.

    Raises:
        ShapeError: wrong shape or length.
        DataError: a position that is not finite; the message names its row.
    """
    places = read_numbers("positions", positions, f"({count}, 3)")
    if places.shape != (count, 3):
        raise ShapeError(
            f"positions: shape {places.shape}, expected ({count}, 3): one position a descriptor"
        )
    _check_finite("positions", places)
    return places


def validate_truth(
    truth: Any, count: int
) -> tuple[NDArray[np.float64], NDArray[np.float64] | None]:
    """Return true positions, float64 (count, 3), and the poses (count, 4, 4) if these were given.

    Raises:
        ShapeError: wrong shape or length.
        DataError: a value that is not finite, or a pose that is no rotation and translation; the
            message names its row.
    """
    numbers = read_numbers("positions", truth, f"({count}, 3) or ({count}, 4, 4)")
    if numbers.ndim != 3:
        return validate_positions(numbers, count), None
    if numbers.shape != (count, 4, 4):
        raise ShapeError(
            f"positions: shape {numbers.shape}, expected ({count}, 3) or poses ({count}, 4, 4)"
        )
    _check_finite("poses", numbers.reshape(count, 16))
    check_rigid("poses", numbers)
    return numbers[:, :3, 3], numbers


def check_rigid(name: str, poses: NDArray[np.float64]) -> None:
    """Raise DataError (code "not-a-rotation") unless poses (N, 4, 4) are rigid motions."""
    for row, pose in enumerate(poses):
        if not is_rigid(pose):
            raise DataError(
                f"{name}: row {row} is no rotation and translation: {pose.tolist()}",
                code="not-a-rotation",
                fields=(name, str(row)),
            )


def check_causal(matches: Matches, window: int) -> None:
    """Raise DataError if a match is not among the candidates j <= i - window - 1."""
    latest = np.arange(len(matches))[:, None] - window - 1
    wrong = np.flatnonzero((matches.indices > np.maximum(latest, -1)).any(axis=1))
    if wrong.size:
        raise DataError(
            f"matches: query {wrong[0]} has candidates {matches.indices[wrong[0]].tolist()}, but "
            f"with window = {window} they must be at most {latest[wrong[0], 0]}"
        )


def _check_finite(name: str, rows: NDArray[np.floating[Any]]) -> None:
    broken = np.flatnonzero(~np.isfinite(rows).all(axis=1))
    if broken.size:
        count = f"{broken.size} of {len(rows)} rows"
        raise DataError(
            f"{name}: row {broken[0]} is not finite ({count})",
            code="not-finite",
            fields=(name, str(broken[0])),
        )
