# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What the service asks of places."""

from typing import NamedTuple, Protocol

from fusionslam.fleet.places import Candidate, PlaceFilter
from fusionslam.sensors.frame import Cloud
from fusionslam.storage.arrays import Floats, Floats32, Integers, Matrix


class Positions(NamedTuple):
    """Where the places of a site are, as far as it is known.

    Attributes:
        sessions: their recordings, one a place.
        frames: int64 (n).
        stamps_ns: int64 (n).
        poses: float64 (n, 4, 4), in a frame of the recording; NaN where unknown.
    """

    sessions: list[str]
    frames: Integers
    stamps_ns: Integers
    poses: Floats


class Located(NamedTuple):
    """What looks like a cloud, and where registration proves it to be.

    Attributes:
        candidates: nearest first.
        best: the candidate that was proven; None if none was.
        best_from_query: float64 (4, 4), maps points of the cloud to that candidate's.
        covariance: float64 (6, 6) of it, translation first.
        probability: that it is right.
        reason: why nothing was proven; None if it was.
    """

    candidates: list[Candidate]
    best: Candidate | None
    best_from_query: Matrix | None
    covariance: Floats | None
    probability: float | None
    reason: str | None


class PlaceSearch(Protocol):
    """Places that are searched. Methods are called from several threads at once."""

    @property
    def descriptor(self) -> str:
        """Name of the descriptor, with its preset."""

    @property
    def length(self) -> int:
        """Length of its vectors."""

    def __len__(self) -> int:
        """Return the number of places."""

    def describe(self, cloud: Cloud) -> Floats32:
        """Describe a cloud in the robot's frame, as the places were; float32 (D,).

        Raises:
            DataError: it cannot be described.
        """

    def query(self, vectors: Floats32, k: int, where: PlaceFilter) -> list[list[Candidate]]:
        """Return the k nearest places of each of some vectors (n, D), nearest first."""

    def locate(self, cloud: Cloud, k: int, where: PlaceFilter) -> Located:
        """Find a cloud, and prove it by registration.

        Raises:
            FusionSlamError: the clouds of places are not stored (code "no-clouds").
        """

    def count_by(self, column: str) -> dict[str, int]:
        """Return numbers of places by site, region, robot or session."""

    def positions(self, site: str) -> Positions:
        """Return where the places of a site are."""

    def close(self) -> None:
        """Let go of the files."""
