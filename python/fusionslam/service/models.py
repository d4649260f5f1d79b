# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Answers of the service, as its OpenAPI page lists them."""

from typing import Self

import numpy as np
from pydantic import BaseModel

from fusionslam.fleet.localization import FleetLocalization
from fusionslam.fleet.place_database import Positions
from fusionslam.fleet.places import Candidate
from fusionslam.storage.arrays import Matrix

Rows = list[list[float]]
"""A matrix, row by row."""


class Problem(BaseModel):
    """Why a request was not answered: programs decide by code and fields."""

    code: str
    message: str
    fields: list[str]


class Described(BaseModel):
    """The descriptor of a cloud."""

    descriptor: str
    length: int
    points: int
    vector: list[float]


class FoundPlace(BaseModel):
    """A place that looks like a query; pose is site_from_robot, null if unknown."""

    key: str
    distance: float
    session: str
    robot: str
    site: str
    region: str
    frame: int
    stamp_ns: int
    pose: Rows | None

    @classmethod
    def of(cls, found: Candidate) -> Self:
        """Return a candidate as an answer."""
        return cls(**{**vars(found), "pose": _rows(found.pose)})


class Found(BaseModel):
    """For each query the places that look like it, nearest first."""

    descriptor: str
    results: list[list[FoundPlace]]


class LocatedCloud(BaseModel):
    """What looks like a cloud, and where registration proves the robot that sent it to be.

    ``place`` is the candidate that proves it, ``place_from_robot`` the robot's pose in the frame of
    the robot that saw the place, with its covariance; ``site_from_robot`` is in the frame of the
    place's recording. They are null without a proof; then ``reason`` says why.
    """

    candidates: list[FoundPlace]
    place: FoundPlace | None
    place_from_robot: Rows | None
    site_from_robot: Rows | None
    covariance: Rows | None
    probability: float
    reason: str | None

    @classmethod
    def of(cls, found: FleetLocalization) -> Self:
        """Return what was found as an answer."""
        return cls(
            candidates=[FoundPlace.of(each) for each in found.candidates],
            place=None if found.place is None else FoundPlace.of(found.place),
            place_from_robot=_rows(found.place_from_robot),
            site_from_robot=_rows(found.site_from_robot),
            covariance=_rows(found.covariance),
            probability=found.probability,
            reason=None if found.reason is None else str(found.reason),
        )


class Counts(BaseModel):
    """How many places there are, and of what; ``proves`` is whether ``/v1/locate`` answers."""

    descriptor: str
    length: int
    proves: bool
    places: int
    sites: dict[str, int]
    regions: dict[str, int]
    sessions: dict[str, int]
    robots: dict[str, int]


class SessionPath(BaseModel):
    """Places of a recording whose position is known: x, y, z in metres, and their frames."""

    session: str
    places: int
    frames: list[int]
    positions: Rows


class SitePaths(BaseModel):
    """The places of a site by recording; ``every`` n-th of them is listed."""

    site: str
    places: int
    every: int
    sessions: list[SessionPath]

    @classmethod
    def of(cls, site: str, found: Positions) -> Self:
        """Return positions as an answer."""
        is_known = np.isfinite(found.poses[:, :3, 3].sum(axis=1)).tolist()
        rows: dict[str, list[int]] = {name: [] for name in found.counts}
        for row, session in enumerate(found.sessions):
            if is_known[row]:
                rows[session].append(row)
        paths = [
            SessionPath(
                session=name,
                places=found.counts[name],
                frames=found.frames[kept].tolist(),
                positions=found.poses[kept, :3, 3].tolist(),
            )
            for name, kept in rows.items()
        ]
        total = sum(found.counts.values())
        return cls(site=site, places=total, every=found.every, sessions=paths)


class Health(BaseModel):
    """Whether the service can answer; ``places`` is null if it cannot."""

    status: str
    places: int | None


def _rows(matrix: Matrix | None) -> Rows | None:
    rows: Rows | None = None if matrix is None else matrix.tolist()
    return rows
