# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What a loop detector, a map or a fleet needs of a frame, computed before the frame is added."""

import logging
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from importlib.util import find_spec

import numpy as np
from numpy.typing import NDArray

from fusionslam.base.argument_types import checked
from fusionslam.base.arrays import Matrix
from fusionslam.config import merged
from fusionslam.descriptors import (
    DescriptorConfig,
    describe,
    describe_or_zeros,
    find_descriptor,
    for_clouds,
    for_sequence,
    length_of,
)
from fusionslam.errors import ConfigError, DataError, FusionSlamError, ShapeError
from fusionslam.fusion import FusionConfig, fuse, robot_from_cloud
from fusionslam.loop_closure.config import LoopConfig
from fusionslam.loop_closure.local_maps import (
    Piece,
    RecentFrames,
    join_clouds,
    pieces_to_join,
    views_of,
)
from fusionslam.registration import PreparedCloud, RegistrationConfig, fit_lengths
from fusionslam.registration.clouds import check_points
from fusionslam.registration.leveling import Level, find_level
from fusionslam.sensors.frame import Cloud, Frame, read_pose
from fusionslam.sensors.point_times import Span

logger = logging.getLogger(__name__)

Vectors = Mapping[str, NDArray[np.float32]]


@dataclass(frozen=True)
class Observation:
    """What is needed of a frame, computed before it is added.

    Attributes:
        vectors: descriptors by name, the detector's own first; zeros where there is none.
        stamp_ns: of the frame; None if unknown.
        cloud: for registration; None if loops are not verified.
        odometry: odom_from_cloud, float64 (4, 4); None if unknown, or loops are not verified.
        span: when the cloud's points were measured; None if unknown, or the cloud knows how it
            moved.
        fitted: how clouds are described, if this first frame fixed it.
        points: number of points of the frame's cloud.
        piece: what it gives to the local maps of the next frames; None if there are none.
        joined: number of frames before it that its own local map is joined of.
        level: how the cloud was levelled; None if it was not asked.
    """

    vectors: Vectors
    stamp_ns: int | None
    cloud: PreparedCloud | None = None
    odometry: Matrix | None = None
    span: Span | None = None
    fitted: DescriptorConfig | None = None
    points: int = 0
    piece: Piece | None = None
    joined: int = 0
    level: Level | None = None

    def scan(self) -> PreparedCloud | None:
        """Prepare the frame's own cloud, where ``cloud`` is that of a local map; else None."""
        if self.piece is None or self.cloud is None:
            return None
        return PreparedCloud(
            self.piece.whole, self.cloud.config, colored=self.piece.cloud, level=self.level
        )

    def add_to(self, recent: RecentFrames, number: int) -> None:
        """Tell the frames that follow; ``number`` is that of the frame."""
        if self.piece is not None and self.cloud is not None:
            recent.add_piece(number, self.piece, self.cloud.config.local_map or 0.0)
        if self.odometry is not None and self.level is not None and self.level.source == "ground":
            recent.add_ground(self.odometry[:3, :3] @ self.level.up)


@checked
def fusion_of_scans(fusion: FusionConfig, registration: RegistrationConfig) -> FusionConfig:
    """Return how clouds that are registered are fused: a scan whole, though a camera sees a part.

    Method planar registers coloured clouds alone, as they are described.
    """
    if fusion.source != "lidar" or registration.method == "planar":
        return fusion
    return merged(fusion, {"source": "cloud", "ground": "none"})


@dataclass(frozen=True)
class FrameObserver:
    """Describes frames, and prepares their clouds for registration.

    Attributes:
        names: of descriptors, with their presets if they were given with them, by the names of
            the vectors that they make.
        describe, fusion, registration: as of ``LoopDetector``.
        verifies: whether clouds are prepared.
        voters: further descriptors, of the whole scan where there is one.
        fits_lengths: whether the first cloud fixes lengths of registration.

    Raises:
        ConfigError: clouds in a frame that a descriptor is not for.
    """

    names: Mapping[str, str]
    describe: DescriptorConfig
    fusion: FusionConfig
    registration: RegistrationConfig
    verifies: bool = False
    voters: tuple[str, ...] = ()
    fits_lengths: bool = False

    def __post_init__(self) -> None:
        for name in self.names.values():
            for_clouds(self.describe, name, self.fusion)

    def verifying(self, voters: Iterable[str]) -> "FrameObserver":
        """Return one that prepares clouds, and describes them for those voters that can be.

        Raises:
            ConfigError: a voter needs normals or colours.
        """
        chosen = tuple(name for name in voters if self._can_vote(name))
        return replace(self, verifies=True, voters=chosen)

    def fixed_by(self, first: Observation) -> "FrameObserver":
        """Return one that takes all clouds as the first one was taken."""
        return replace(
            self,
            describe=first.fitted or self.describe,
            registration=self.registration if first.cloud is None else first.cloud.config,
            fits_lengths=False,
        )

    def observe(
        self,
        frame_or_cloud: Frame | Cloud,
        *,
        stamp_ns: int | None = None,
        odometry: Matrix | None = None,
        is_first: bool = False,
        fused: Cloud | None = None,
        before: RecentFrames | None = None,
    ) -> Observation:
        """Describe a frame; arguments and errors as of ``LoopDetector.add``.

        Args:
            frame_or_cloud, stamp_ns, odometry: of the frame.
            is_first: whether it fixes lengths of descriptors and of registration.
            fused: the frame's cloud, if it is fused already.
            before: what the frames before tell, for its local map and which way is up; None leaves
                the cloud single.
        """
        if not isinstance(frame_or_cloud, Frame | Cloud):
            raise ShapeError(f"expected a Frame or a Cloud, got {type(frame_or_cloud).__name__}")
        frame = frame_or_cloud if isinstance(frame_or_cloud, Frame) else None
        cloud = frame_or_cloud if isinstance(frame_or_cloud, Cloud) else fused
        if frame is not None:
            stamp_ns = frame.stamp_ns if stamp_ns is None else stamp_ns
            cloud = fuse(frame, self.fusion) if fused is None else fused
        assert cloud is not None
        points = len(cloud)
        if not self.verifies:
            vectors, fitted = self._describe(cloud, frame, is_first=is_first)
            return Observation(vectors, stamp_ns, fitted=fitted, points=points)
        whole = cloud  # that is registered
        if frame is not None and self._has_whole_scans:
            whole = fuse(frame, fusion_of_scans(self.fusion, self.registration))
        mount: Matrix | None = None  # robot_from_cloud
        if frame is not None and frame.robot_from_points is not None:
            mount = robot_from_cloud(frame, self.fusion)
        if odometry is None and frame is not None and frame.odometry is not None:
            odometry = frame.odometry @ robot_from_cloud(frame, self.fusion)
        odometry = read_pose("odometry", odometry)
        if odometry is not None and not np.isfinite(odometry).all():  # it is unknown
            odometry = None
        check_points(whole.points)
        lengths, found = self.registration, None
        if lengths.gravity == "auto" and lengths.method != "planar":
            found = find_level(whole.points, odometry, mount, None if before is None else before.up)
        if is_first and self.fits_lengths:
            lengths = fit_lengths([level(whole, found)], lengths)
        seen, piece, joined = whole, None, list[Piece]()
        if lengths.local_map and odometry is not None and before is not None:
            piece = Piece.of(cloud, whole, odometry, lengths)
            joined = pieces_to_join(before.pieces, odometry, lengths.local_map)
            back = np.linalg.inv(odometry)
            poses = [np.eye(4), *(back @ each.odometry for each in joined)]
            voxel, is_whole = lengths.voxel / 2, cloud is whole
            wholes = [whole, *(each.whole for each in joined)]
            whole = join_clouds(zip(poses, wholes, strict=True), voxel)
            described = [cloud, *(each.cloud for each in joined)]
            cloud = whole if is_whole else join_clouds(zip(poses, described, strict=True), voxel)
        upright, upright_whole = level(cloud, found), level(whole, found)
        vectors, fitted = self._describe(upright, frame, is_first=is_first)
        if fitted is not None:
            fitted = for_sequence(fitted, self.voters, upright_whole)
        for name in self.voters:
            config = for_clouds(fitted or self.describe, name, self.fusion, frame)
            vectors[name_voter(name)], problem = describe_or_zeros(upright_whole, name, config)
            if problem is not None:
                logger.debug("no candidates by %s: %s", name, problem)
        prepared = PreparedCloud(
            whole,
            lengths,
            colored=cloud,
            level=found,
            seen=seen.points,
            further=views_of(joined, odometry) if joined and odometry is not None else (),
        )
        if is_first and lengths.method != "planar":
            _say_how_it_is_taken(prepared, found)
        span = None if frame is None else frame.span
        return Observation(
            vectors, stamp_ns, prepared, odometry, span, fitted, points, piece, len(joined), found
        )

    def _describe(
        self, cloud: Cloud, frame: Frame | None, *, is_first: bool
    ) -> tuple[dict[str, NDArray[np.float32]], DescriptorConfig | None]:
        """Describe a cloud by each descriptor, zeros by those that cannot; and what it fixes.

        Raises:
            DataError: none of them can.
        """
        vectors: dict[str, NDArray[np.float32]] = {}
        problems: dict[str, DataError] = {}
        fitted = for_sequence(self.describe, self.names.values(), cloud) if is_first else None
        for key, name in self.names.items():
            config = for_clouds(fitted or self.describe, name, self.fusion, frame)
            try:
                vectors[key] = describe(cloud, name, config)
            except DataError as error:
                problems[key] = error
        if problems and not any(vector.any() for vector in vectors.values()):
            raise [*problems.values()][-1]
        for key in problems:
            vectors[key] = np.zeros(length_of(self.names[key], self.describe), np.float32)
        return vectors, fitted

    @property
    def _has_whole_scans(self) -> bool:
        """Whether frames have a scan of which the camera sees a part."""
        return fusion_of_scans(self.fusion, self.registration) != self.fusion

    def _can_vote(self, name: str) -> bool:
        kind = find_descriptor(name)
        if "normals" in kind.needs or (kind.needs_colors and self._has_whole_scans):
            raise ConfigError(
                f"loop_closure.voters has {name!r}, which needs normals or colours",
                code="choice",
                fields=("loop_closure.voters", name),
            )
        if name in self.names and not self._has_whole_scans:
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
    if registration.method == "planar" or registration.gravity or find_spec("kiss_matcher"):
        return True
    why = (
        "registration without gravity needs KISS-Matcher, which is not installed: pip install "
        "'fusionslam[map]'"
    )
    if config.verify is None:
        logger.warning("loops are not verified: %s; verify=False says so", why)
        return False
    raise FusionSlamError(f"loops cannot be verified: {why}", code="missing-extra", fields=("map",))


def level(cloud: Cloud, found: Level | None) -> Cloud:
    """Return a cloud levelled by what ``find_level`` found."""
    if found is None or found.level_from_cloud is None:
        return cloud
    points = np.ascontiguousarray(cloud.points @ found.level_from_cloud.T, np.float32)
    return replace(cloud, points=points)


def _say_how_it_is_taken(cloud: PreparedCloud, level: Level | None) -> None:
    """Say what was found of the first cloud, and that views of rooms look alike."""
    if level is not None and level.level_from_cloud is not None:
        logger.info("clouds are levelled: tilted by %.0f deg (%s)", level.tilt, level.source)
    if cloud.config.local_map:
        logger.info("clouds along %.2g m are joined to local maps", cloud.config.local_map)
    elif cloud.is_sector and cloud.shows_room and len(cloud):
        logger.warning(
            "the first scan shows less than half of the circle, in a room: such views look alike, "
            "and some of the loops will be wrong; on a level floor registration.method=planar "
            "proves them better"
        )
