# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Answers of the service, as its OpenAPI page lists them."""

from collections.abc import Callable, Container
from typing import Self

import numpy as np
from pydantic import BaseModel

from fusionslam.base.arrays import Matrix
from fusionslam.fleet.joint_map import JointMap
from fusionslam.fleet.localization import FleetLocalization
from fusionslam.fleet.place_database import Positions
from fusionslam.fleet.places import Candidate

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


class LocatedPlace(FoundPlace):
    """The same with its pose in the joint map of its site, map_from_robot.

    It is interpolated between keyframes; null if there is no map, or it does not join the recording
    there.
    """

    map_pose: Rows | None

    @classmethod
    def on(cls, found: Candidate, joint: JointMap | None) -> Self:
        """Return a candidate as an answer, with its place in a map."""
        seen = None if joint is None else joint.pose_at(found.session, found.frame)
        return cls(**vars(FoundPlace.of(found)), map_pose=_rows(seen))


class LocatedCloud(BaseModel):
    """What looks like a cloud, and where registration proves the robot that sent it to be.

    ``place`` is the candidate that proves it, ``place_from_robot`` the robot's pose in the frame of
    the robot that saw the place, with its covariance; ``site_from_robot`` is in the frame of the
    place's recording. They are null without a proof; then ``reason`` says why. ``map_from_robot``
    is in the frame of the site's joint map; null, too, if ``map_pose`` of the place is.
    """

    candidates: list[LocatedPlace]
    place: LocatedPlace | None
    place_from_robot: Rows | None
    site_from_robot: Rows | None
    map_from_robot: Rows | None
    covariance: Rows | None
    probability: float
    reason: str | None

    @classmethod
    def of(cls, found: FleetLocalization, maps: Callable[[str], JointMap | None]) -> Self:
        """Return what was found as an answer, in the joint maps of sites, too."""
        pose = found.place_from_robot
        places = [LocatedPlace.on(each, maps(each.site)) for each in found.candidates]
        place = next((each for each in places if found.place and each.key == found.place.key), None)
        seen = None if place is None else place.map_pose
        return cls(
            candidates=places,
            place=place,
            place_from_robot=_rows(pose),
            site_from_robot=_rows(found.site_from_robot),
            map_from_robot=None if seen is None or pose is None else _rows(np.array(seen) @ pose),
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


class MapPath(BaseModel):
    """Keyframes of a recording in the frame of the joint map: x, y, z in metres, their frames."""

    session: str
    keyframes: int
    frames: list[int]
    positions: Rows


class MapPaths(BaseModel):
    """The joint map of a site: the recordings that it joins; ``every`` n-th keyframe is listed."""

    keyframes: int
    every: int
    sessions: list[MapPath]

    @classmethod
    def of(cls, joint: JointMap, sessions: Container[str], most: int) -> Self:
        """Return some sessions of a map as an answer, thinned out to about so many keyframes."""
        drives = {
            name: np.flatnonzero(np.isfinite(drive.poses[:, 0, 0]))
            for name, drive in joint.drives.items()
            if name in sessions  # others may have been forgotten meanwhile
        }
        total = sum(map(len, drives.values()))
        every = max(1, -(-total // most))
        paths = [
            MapPath(
                session=name,
                keyframes=len(rows),
                frames=joint.drives[name].frames[rows[::every]].tolist(),
                positions=joint.drives[name].poses[rows[::every], :3, 3].tolist(),
            )
            for name, rows in drives.items()
        ]
        return cls(keyframes=total, every=every, sessions=paths)


class SitePaths(BaseModel):
    """The places of a site by recording, each in a frame of its own; ``every`` n-th is listed.

    ``map`` is the joint map, in whose frame recordings are joined; null if there is none.
    """

    site: str
    places: int
    every: int
    sessions: list[SessionPath]
    map: MapPaths | None

    @classmethod
    def of(cls, site: str, found: Positions, joint: JointMap | None, most: int) -> Self:
        """Return positions, and keyframes of the joint map, at most about so many."""
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
        return cls(
            site=site,
            places=sum(found.counts.values()),
            every=found.every,
            sessions=paths,
            map=None if joint is None else MapPaths.of(joint, found.counts, most),
        )


class Health(BaseModel):
    """Whether the service can answer; ``places`` is null if it cannot."""

    status: str
    places: int | None


def _rows(matrix: Matrix | None) -> Rows | None:
    rows: Rows | None = None if matrix is None else matrix.tolist()
    return rows
