# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Finds where a cloud was seen before by any robot, and proves it by registration."""

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple, Protocol

import numpy as np

from fusionslam.base.arrays import Floats32, Matrix
from fusionslam.base.progress import Progress
from fusionslam.config import merged
from fusionslam.errors import DataError
from fusionslam.fleet.chunk import PlaceCloud
from fusionslam.fleet.config import FleetSettings
from fusionslam.fleet.places import Candidate, PlaceFilter
from fusionslam.fusion import fuse, robot_from_cloud
from fusionslam.geometry.se3 import carry_covariance
from fusionslam.loop_closure.config import LoopConfig
from fusionslam.loop_closure.observation import Observation
from fusionslam.loop_closure.verification import PairComparisons, verify_candidates
from fusionslam.registration import PreparedCloud, Refusal
from fusionslam.sensors.frame import Cloud, Frame

logger = logging.getLogger(__name__)


class PlaceSearch(Protocol):
    """What is asked of a database of places."""

    def query(
        self, vectors: Floats32, k: int = 10, where: PlaceFilter | None = None
    ) -> list[list[Candidate]]:
        """Return the k nearest places of each vector."""


class PlaceClouds(Protocol):
    """What is asked for the clouds of places."""

    def cloud(self, key: str) -> PlaceCloud:
        """Return the cloud of a place. Raises DataError (code "no-cloud") if there is none."""


@dataclass(frozen=True)
class FleetLocalization:
    """Where a robot is, as far as any robot has been there.

    Attributes:
        candidates: places that look alike, the nearest descriptor first.
        place: the one that a pose was proven with; None if none was.
        place_from_robot: float64 (4, 4), the robot's pose in the frame of the robot that saw the
            place; None without a proof.
        site_from_robot: float64 (4, 4), the same in the frame of the place's recording; None if
            its pose is unknown.
        covariance: float64 (6, 6), as of ``Localization``; None without a pose.
        probability: of the pose, 0 to 1.
        reason: why there is no pose; None if there is one.
    """

    candidates: Sequence[Candidate]
    place: Candidate | None = None
    place_from_robot: Matrix | None = None
    site_from_robot: Matrix | None = None
    covariance: Matrix | None = None
    probability: float = 0.0
    reason: Refusal | None = None


class PlaceQuery(NamedTuple):
    """A cloud that is described, to be looked for.

    Attributes:
        vector: float32 (D,).
        prepare: returns the cloud for registration.
        mount: float64 (4, 4), robot_from_cloud; None if it is unknown.
    """

    vector: Floats32
    prepare: Callable[[], PreparedCloud]
    mount: Matrix | None

    def packed(self) -> "PlaceQuery":
        """Return the same without its scan, in some 50 kB: thousands may wait to be proven."""
        cloud = self.prepare()
        prepare = partial(PreparedCloud.from_bytes, cloud.to_bytes(), cloud.config)
        return self._replace(prepare=prepare)


class FleetLocator:
    """Describes clouds as those of a folder were, and finds where they were seen.

    Args:
        search: the database of places.
        clouds: of the places.
        settings: of the folder.
        loops: which candidates are tried and accepted.
    """

    def __init__(
        self,
        search: PlaceSearch,
        clouds: PlaceClouds,
        settings: FleetSettings,
        loops: LoopConfig | None = None,
    ) -> None:
        self._search, self._clouds, self._settings = search, clouds, settings
        self._loops = loops or LoopConfig()

    def describe(self, frame_or_cloud: Frame | Cloud) -> Floats32:
        """Return the vector by which places are looked for, float32 (D,).

        Raises:
            DataError: a cloud that cannot be described, or a frame that cannot be fused.
        """
        seen, _ = self._observe(frame_or_cloud, verifies=False)
        return seen.vectors[self._settings.names[0]]

    def find(
        self, frame_or_cloud: Frame | Cloud, k: int = 10, where: PlaceFilter | None = None
    ) -> list[Candidate]:
        """Return the k places that look most like a cloud.

        Args:
            frame_or_cloud: a frame; or a scan, metres, which is treated as those of the places
                were: in the frame of the scanner, or of the robot if ``fusion.frame`` is robot.
                Its scanner is taken to sit on the robot as that of the place that is found.
            k: number of places, at least 1.
            where: which places are asked.

        Raises:
            DataError: as ``describe``.
        """
        (found,) = self.find_all([self.describe(frame_or_cloud)], k, where)
        return found

    def localize(
        self, frame_or_cloud: Frame | Cloud, k: int = 10, where: PlaceFilter | None = None
    ) -> FleetLocalization:
        """Find a cloud, and prove it by registration with the candidates.

        Arguments and errors as of ``find``; candidates whose clouds are not stored, or cannot be
        read, prove nothing.
        """
        (found,) = self.localize_all([self.query_of(frame_or_cloud)], k, where)
        return found

    def localize_place(
        self, key: str, vector: Floats32, k: int = 10, where: PlaceFilter | None = None
    ) -> FleetLocalization:
        """As ``localize``, for a place that is stored, with its vector, float32 (D,).

        Raises:
            DataError: its cloud is not stored (code "no-cloud").
        """
        stored = self._clouds.cloud(key)
        query = PlaceQuery(vector, stored.frame.unpack, stored.robot_from_cloud)
        (found,) = self.localize_all([query], k, where)
        return found

    def query_of(self, frame_or_cloud: Frame | Cloud) -> PlaceQuery:
        """Describe a cloud for ``localize_all``; argument and errors as of ``find``."""
        seen, mount = self._observe(frame_or_cloud, verifies=True)
        cloud = seen.cloud
        assert cloud is not None
        return PlaceQuery(seen.vectors[self._settings.names[0]], lambda: cloud, mount)

    def _observe(
        self, frame_or_cloud: Frame | Cloud, *, verifies: bool
    ) -> tuple[Observation, Matrix | None]:
        """Observe a frame, or treat a scan as the places were; and robot_from_cloud if known."""
        fusion = self._settings.fusion
        observer = self._settings.observer(self._settings.names[:1], verifies=verifies)
        if isinstance(frame_or_cloud, Frame):
            seen = observer.observe(frame_or_cloud)
            return seen, robot_from_cloud(frame_or_cloud, fusion)
        scan = frame_or_cloud
        frame = Frame(
            points=scan.points,
            colors=scan.colors,
            intensities=scan.intensities,
            robot_from_points=np.eye(4),
        )
        fused = fuse(frame, merged(fusion, {"source": "cloud"}))
        return observer.observe(frame, fused=fused), None

    def find_all(
        self, vectors: Sequence[Floats32], k: int = 10, where: PlaceFilter | None = None
    ) -> list[list[Candidate]]:
        """As ``find``, for the vectors of several clouds, float32 (D,) each, by one search."""
        return self._search.query(np.stack(vectors), k, where) if vectors else []

    def localize_all(
        self,
        queries: Sequence[PlaceQuery],
        k: int = 10,
        where: PlaceFilter | None = None,
        *,
        progress: Progress | None = None,
    ) -> list[FleetLocalization]:
        """As ``localize``, for several clouds by one search.

        Args:
            queries: the clouds, of ``query_of``; ``packed`` if there are many.
            k, where: as of ``find``.
            progress: called with (clouds done, total).
        """
        found = []
        candidates = self.find_all([each.vector for each in queries], k, where)
        for query, some in zip(queries, candidates, strict=True):
            found.append(self._prove(query, some))
            if progress is not None:
                progress(len(found), len(queries))
        return found

    def _load(
        self, candidates: Sequence[Candidate]
    ) -> tuple[dict[int, PlaceCloud], DataError | None]:
        """Return the clouds of the candidates that have one, by rank, and why the last has none."""
        found, problem = {}, None
        for rank, each in enumerate(candidates):
            try:
                found[rank] = self._clouds.cloud(each.key)
            except DataError as error:
                problem = error
                if error.code not in ("no-cloud", "missing-file"):  # as of a forgotten robot
                    logger.warning("%s; fleet describe makes it anew", error)
        return found, problem

    def _prove(self, query: PlaceQuery, candidates: Sequence[Candidate]) -> FleetLocalization:
        """Register a cloud with its candidates; return the first pose that counts."""
        if not candidates:
            text = "no place is stored that is asked for"
            return FleetLocalization(candidates, reason=Refusal("no-candidates", 0, text))
        clouds, problem = self._load(candidates)
        if not clouds:
            text = f"no candidate has a cloud that can prove anything: {problem}"
            return FleetLocalization(candidates, reason=Refusal("no-cloud", 0, text))
        distances = {rank: candidates[rank].distance for rank in clouds}
        pairs = PairComparisons(query.prepare(), lambda rank: clouds[rank].frame)
        best, _ = verify_candidates(-1, distances, pairs, self._loops)
        if best is None:
            text = "no candidate's cloud has anything in common with this one"
            return FleetLocalization(candidates, reason=Refusal("no-match", 0, text))
        probability = best.probability or 0.0
        if best.reason is not None or best.match_from_query is None:
            return FleetLocalization(candidates, probability=probability, reason=best.reason)
        place = candidates[best.match]
        there = clouds[best.match].robot_from_cloud
        # A scanner of unknown place sits as that of the other robot.
        mount = there if query.mount is None else query.mount
        pose = there @ best.match_from_query @ np.linalg.inv(mount)
        return FleetLocalization(
            candidates,
            place,
            pose,
            None if place.pose is None else place.pose @ pose,
            None if best.covariance is None else carry_covariance(mount, best.covariance),
            probability,
        )
