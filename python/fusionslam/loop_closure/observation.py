# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What a loop detector needs of a frame, computed before the frame is added."""

import logging
from collections.abc import Iterable
from dataclasses import dataclass, replace
from importlib.util import find_spec

import numpy as np
from numpy.typing import NDArray

from fusionslam.argument_types import checked
from fusionslam.config import merged
from fusionslam.descriptors import (
    DescriptorConfig,
    describe,
    describe_or_zeros,
    find_descriptor,
    for_clouds,
    for_sequence,
)
from fusionslam.errors import ConfigError, FusionSlamError, ShapeError
from fusionslam.fusion import FusionConfig, fuse, robot_from_cloud
from fusionslam.loop_closure.config import LoopConfig
from fusionslam.loop_closure.memory import Evidence, Vectors
from fusionslam.registration import (
    PreparedCloud,
    RegistrationConfig,
    fit_lengths,
)
from fusionslam.sensors.frame import Cloud, Frame
from fusionslam.sensors.scan_motion import span_of
from fusionslam.storage.arrays import Matrix

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class Observation:
    """What a detector needs of a frame, computed before it is added.

    Attributes:
        vectors: descriptors by name, the detector's own first.
        stamp_ns: of the frame; None if unknown.
        evidence: its cloud; None if loops are not verified.
        radius: for normals, if this first frame fixed it.
        points: number of points of the cloud.
    """

    vectors: Vectors
    stamp_ns: int | None
    evidence: Evidence | None = None
    radius: float | None = None
    points: int = 0


@checked
def fusion_of_scans(fusion: FusionConfig, registration: RegistrationConfig) -> FusionConfig:
    """Return how clouds that are registered are fused: a scan whole, though a camera sees a part.

    Method planar registers coloured clouds alone, as they are described.
    """
    if fusion.source != "lidar" or registration.method == "planar":
        return fusion
    return merged(fusion, {"source": "cloud", "ground": "none"})


def whole_scan(
    frame: Frame | None, cloud: Cloud, fusion: FusionConfig, registration: RegistrationConfig
) -> Cloud:
    """Return the cloud of a frame that is registered, where ``cloud`` is the one described.

    That is the same one where the camera sees all of the scan, or there is no frame.
    """
    of_scans = fusion_of_scans(fusion, registration)
    return cloud if frame is None or of_scans == fusion else fuse(frame, of_scans)


def prepare_cloud(
    whole: Cloud,
    colored: Cloud,
    registration: RegistrationConfig,
    *,
    fits_lengths: bool = False,
    is_first: bool = False,
) -> PreparedCloud:
    """Prepare a cloud for registration.

    Args:
        whole: the cloud (``whole_scan``).
        colored: the part of it that is described, which may have colours.
        registration: how clouds are registered.
        fits_lengths: whether lengths are fitted to this cloud.
        is_first: whether to warn of a view too narrow for certain loops.
    """
    lengths = fit_lengths([whole], registration) if fits_lengths else registration
    prepared = PreparedCloud(whole, lengths, colored=colored)
    if is_first and lengths.method != "planar":
        _warn_of_narrow_views(prepared)
    return prepared


def odometry_of(frame: Frame, fusion: FusionConfig) -> Matrix | None:
    """Return odom_from_cloud of a frame, float64 (4, 4); None if its odometry is unknown."""
    if frame.odometry is None:
        return None
    return frame.odometry @ robot_from_cloud(frame, fusion)


@dataclass(frozen=True)
class FrameObserver:
    """Describes frames, and prepares their clouds for registration.

    Attributes:
        name: of the descriptor, with its preset if it was given with one.
        describe, fusion, registration: as of ``LoopDetector``.
        verifies: whether clouds are prepared.
        voters: further descriptors.
        fits_lengths: whether the first cloud fixes lengths of registration.

    Raises:
        ConfigError: clouds in a frame that the descriptor is not for.
    """

    name: str
    describe: DescriptorConfig
    fusion: FusionConfig
    registration: RegistrationConfig
    verifies: bool = False
    voters: tuple[str, ...] = ()
    fits_lengths: bool = False

    def __post_init__(self) -> None:
        for_clouds(self.describe, find_descriptor(self.name).name, self.fusion)

    def verifying(self, voters: Iterable[str]) -> "FrameObserver":
        """Return one that prepares clouds, and describes them for those voters that can be.

        Raises:
            ConfigError: a voter needs normals or colours.
        """
        chosen = tuple(name for name in voters if self._can_vote(name))
        return replace(self, verifies=True, voters=chosen)

    def observe(
        self,
        frame_or_cloud: Frame | Cloud,
        *,
        stamp_ns: int | None,
        odometry: Matrix | None,
        is_first: bool,
    ) -> Observation:
        """Describe a frame; arguments and errors as of ``LoopDetector.add``.

        Args:
            frame_or_cloud, stamp_ns, odometry: of the frame.
            is_first: whether it fixes the radius of normals.
        """
        frame = frame_or_cloud if isinstance(frame_or_cloud, Frame) else None
        if frame is not None:
            stamp_ns = frame.stamp_ns if stamp_ns is None else stamp_ns
            cloud = fuse(frame, self.fusion)
        elif isinstance(frame_or_cloud, Cloud):
            cloud = frame_or_cloud
        else:
            raise ShapeError(f"expected a Frame or a Cloud, got {type(frame_or_cloud).__name__}")
        kind = find_descriptor(self.name)
        config = for_clouds(self.describe, kind.name, self.fusion, frame)
        radius = None
        if kind.fixes_radius and is_first:
            config = for_sequence(config, cloud)
            radius = config.normal_radius
        vectors: dict[str, NDArray[np.float32]] = {kind.name: describe(cloud, self.name, config)}
        if not self.verifies:
            return Observation(vectors, stamp_ns, None, radius, len(cloud))
        whole = whole_scan(frame, cloud, self.fusion, self.registration)
        for name in self.voters:
            vectors[name_voter(name)] = self._vote(whole, name, frame)
        prepared = prepare_cloud(
            whole, cloud, self.registration, fits_lengths=self.fits_lengths, is_first=is_first
        )
        if odometry is None and frame is not None:
            odometry = odometry_of(frame, self.fusion)
        span = None if frame is None else span_of(frame)
        evidence = Evidence(prepared, odometry, span)
        return Observation(vectors, stamp_ns, evidence, radius, len(cloud))

    @property
    def _has_whole_scans(self) -> bool:
        """Whether frames have a scan of which the camera sees a part."""
        return fusion_of_scans(self.fusion, self.registration) != self.fusion

    def _vote(self, cloud: Cloud, name: str, frame: Frame | None) -> NDArray[np.float32]:
        """Describe a cloud for a further descriptor; zeros if it cannot be."""
        config = for_clouds(self.describe, name, self.fusion, frame)
        vector, problem = describe_or_zeros(cloud, name, config)
        if problem is not None:
            logger.debug("no candidates by %s: %s", name, problem)
        return vector

    def _can_vote(self, name: str) -> bool:
        kind = find_descriptor(name)
        if "normals" in kind.needs or (kind.needs_colors and self._has_whole_scans):
            raise ConfigError(
                f"loop_closure.voters has {name!r}, which needs normals or colours",
                code="choice",
                fields=("loop_closure.voters", name),
            )
        if name == find_descriptor(self.name).name and not self._has_whole_scans:
            return False
        if "up" in kind.needs and not self.registration.gravity:
            return False
        try:
            for_clouds(self.describe, name, self.fusion)
        except ConfigError as error:
            logger.info("no candidates by %s: %s", name, error)
            return False
        return True


def name_voter(name: str) -> str:
    """Name of a further descriptor's vectors, which may be those of another cloud."""
    return f"{name}, voting"


def can_verify(config: LoopConfig, registration: RegistrationConfig) -> bool:
    """Whether loops are verified. Raises FusionSlamError if they must be and cannot."""
    if config.verify is False or (config.verify is None and config.threshold is not None):
        return False
    needed = [] if registration.method == "planar" else ["small_gicp"]
    if needed and not registration.gravity:
        needed.append("kiss_matcher")
    missing = [name for name in needed if find_spec(name) is None]
    if not missing:
        return True
    why = (
        f"registration needs {' and '.join(missing)}, which is not installed: pip install "
        "'fusionslam[map]'"
    )
    if config.verify is None:
        logger.warning("loops are not verified: %s; verify=False says so", why)
        return False
    raise FusionSlamError(f"loops cannot be verified: {why}", code="missing-extra", fields=("map",))


def _warn_of_narrow_views(cloud: PreparedCloud) -> None:
    """Say that some poses of sectors in rooms are wrong however probable they look."""
    if cloud.is_sector and cloud.shows_room and len(cloud):
        logger.warning(
            "the first scan shows less than half of the circle, in a room: such views look alike, "
            "and some of the loops will be wrong; on a level floor registration.method=planar "
            "proves them better"
        )
