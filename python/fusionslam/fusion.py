# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Turns frames into coloured clouds, from LiDAR and camera or from a stereo pair.

The steps are C++ (``fusionslam.colorize``, ``stereo_disparity``, ...); this module chooses
between them and sets frame, ground removal and density (Perdomo 2019, section 3.3; Stastny 2022,
section 4.3).
"""

import logging
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import create_model

from fusionslam._core import (
    GroundPlaneConfig,
    GroundSegmentsConfig,
    StereoConfig,
    above_height,
    cloud_from_disparity,
    colorize,
    colorize_all_round,
    drop_invalid,
    remove_ground_plane,
    remove_ground_segments,
    stereo_disparity,
    voxel_downsample,
)
from fusionslam.base import texts
from fusionslam.base.argument_types import checked
from fusionslam.base.texts import PER_FRAME, counted
from fusionslam.config import CoreConfig, Section, core_section, option
from fusionslam.errors import ConfigError, DataError, ShapeError
from fusionslam.sensors.frame import Camera, Cloud, CloudFrame, Frame

_FARTHEST_M = 10_000.0
"""Beyond the range of any LiDAR."""
DISTANT_M = 500.0
"""Beyond what a robot's LiDAR sees of most of its surroundings, in metres."""
_COS_45, _COS_60 = 0.5**0.5, 0.5
_NEARLY_ALL = 0.99
_ENOUGH_POINTS = 4096
# Ground heights below a car's LiDAR, which is mounted at 1.73 m (KITTI), and in a robot's frame
# (Stastny's program).
_SCAN_GROUND_M, _ROBOT_GROUND_M = -1.4, 0.1
# Ground parameters in the robot's and the odometry frame. The core's defaults, made for cars, take
# the feet of furniture for floor there; docs/stages/fusion.md has the figures.
_ROBOT_PLANE = {"distance": 0.05, "max_tilt": 5.0}
_ROBOT_SEGMENTS = {"seed_height": 0.2, "distance": 0.1}


def _ground_section(name: str, core: type[CoreConfig], robots: dict[str, float]) -> type[Section]:
    """Section of a core configuration in which the default of some values depends on the frame."""
    fields = {}
    for entry in core.options():
        if entry["name"] in robots:
            help = (
                f"{entry['help']}; null is {entry['default']} in the scan's frame (a car's), "
                f"{robots[entry['name']]} in the robot's and in odometry's"
            )
            limits = {"ge": entry["minimum"], "le": entry["maximum"]}
            fields[entry["name"]] = (
                float | None,
                option(None, help, unit=entry["unit"], **limits),
            )
    base = core_section(name, core, __name__)
    return create_model(name, __base__=base, __module__=__name__, **fields)  # type: ignore[call-overload, no-any-return]


if TYPE_CHECKING:

    class StereoSection(Section): ...

    class PlaneSection(Section): ...

    class SegmentsSection(Section): ...

else:
    StereoSection = core_section("StereoSection", StereoConfig, __name__, optional=True)
    PlaneSection = _ground_section("PlaneSection", GroundPlaneConfig, _ROBOT_PLANE)
    SegmentsSection = _ground_section("SegmentsSection", GroundSegmentsConfig, _ROBOT_SEGMENTS)
logger = logging.getLogger(__name__)

Source = Literal["lidar", "stereo", "cloud"]
SENSORS_OF: Mapping[str, tuple[str, ...]] = {
    "lidar": ("points", "left"),
    "stereo": ("left", "right"),
    "cloud": ("points",),
}
"""Sensors that a frame needs, by source of clouds. Of several cameras that colour scans it needs
any one; recordings take the further ones along (``color_cameras``)."""
SOURCES = tuple(SENSORS_OF)


class FusionConfig(Section):
    """Configuration of how frames become coloured clouds."""

    source: Source = option("lidar", texts.SOURCE)
    interpolation: Literal["nearest", "bilinear"] = option("nearest", "how a pixel is read")
    cameras: tuple[str, ...] | None = option(
        None,
        "source lidar: names of the cameras that colour the scan; null is all that there are, but "
        "not the right one of a stereo pair, which looks the same way as the left",
        min_length=1,
    )
    balance: bool = option(
        True, "several cameras: even out their exposure by the points that two of them see"
    )
    frame: CloudFrame = option("scan", texts.CLOUD_FRAME)
    ground: Literal["none", "height", "plane", "segments"] = option("none", texts.GROUND)
    ground_height: float | None = option(
        None,
        "ground: height drops points not above this, in the frame that the ground is looked for "
        f"in; null is {_SCAN_GROUND_M} in the scan's (a car's), {_ROBOT_GROUND_M} in the robot's "
        "and in odometry's",
        unit="m",
    )
    up: Literal["x", "y", "z", "-x", "-y", "-z"] = option(
        "z", "which way is up in the frame that the ground is looked for in"
    )
    voxel: float = option(0.0, "one point a cube of this size; 0 is off", unit="m", ge=0)
    plane: PlaneSection = option(PlaneSection(), "ground: plane, found by RANSAC")
    segments: SegmentsSection = option(
        SegmentsSection(), "ground: segments, a plane each (Zermas et al. 2017)"
    )
    stereo_preset: Literal["image_undistort", "sgbm"] = option(
        "image_undistort", "StereoBM as in Perdomo 2019, or StereoSGBM: slower, denser"
    )
    stereo: StereoSection = option(StereoSection(), "single values instead of the preset's")


@checked
def fuse(frame: Frame, config: FusionConfig | None = None) -> Cloud:
    """Make the coloured cloud of a frame in the configured frame, by default the scan's.

    Points with NaN or infinity are dropped and their number is logged.

    Raises:
        DataError: the frame lacks a sensor, a calibration or a robot pose that the configuration
            needs, and the message names it; an image does not have the calibration's size; or
            most points are farther away than any LiDAR sees. One of several cameras that lacks an
            image or calibration is left out, which is logged; it is an error if none is left.
        TypeError: not a frame, or another configuration.
    """
    config = config or FusionConfig()
    cloud = remove_ground(frame, color_cloud(frame, config), config)
    cloud = _transform(cloud, frame_from_points(frame, config.frame))
    if config.voxel == 0:
        return cloud
    points, colors, first = voxel_downsample(cloud.points, cloud.colors, size=config.voxel)
    kept = subset(cloud, first)
    return replace(kept, points=points, colors=None if cloud.colors is None else colors)


def color_cloud(frame: Frame, config: FusionConfig) -> Cloud:
    """First step: the coloured cloud in the scan's frame, ground included.

    A frame without images whose scan has colours needs no camera.
    """
    has_own = config.source == "lidar" and not frame.images and frame.colors is not None
    if config.source == "cloud" or has_own:
        return _scan(frame)
    return (_lidar_cloud if config.source == "lidar" else _stereo_cloud)(frame, config)


def load_sensors(frame: Frame, config: FusionConfig) -> None:
    """Read now what ``fuse`` needs, so that reading is timed apart from fusing.

    What is missing or damaged is left to ``fuse``, which says what that means.
    """
    names = SENSORS_OF[config.source]
    if config.source == "lidar":
        names = ("points", *color_cameras(frame, config))
    can_lack = len(names) > len(SENSORS_OF[config.source])
    for name in names:
        with suppress(*([DataError] if can_lack and name != "points" else [])):
            _ = frame.points if name == "points" else frame.images.get(name)


def remove_ground(frame: Frame, cloud: Cloud, config: FusionConfig) -> Cloud:
    """Second step: remove the ground from a cloud in the scan's frame."""
    if config.ground == "none" or not len(cloud):
        return cloud
    points = _transform(cloud, frame_from_points(frame, _ground_frame(config))).points
    if config.ground == "height":
        default = _SCAN_GROUND_M if _is_cars(config) else _ROBOT_GROUND_M
        height = default if config.ground_height is None else config.ground_height
        kept = above_height(points, height, up=config.up)
    elif config.ground == "plane":
        kept = remove_ground_plane(points, up=config.up, config=plane_of(config))[0]
    else:
        kept = remove_ground_segments(points, up=config.up, config=segments_of(config))[0]
    if len(kept) == len(cloud):
        _warn(frame, "no ground found, all points are kept")
    return subset(cloud, kept)


def frame_from_points(frame: Frame, name: CloudFrame) -> NDArray[np.float64]:
    """float64 (4, 4): maps points of the scan to one of the frames that clouds can be in.

    Raises:
        DataError: the transform is not known for this frame.
    """
    if name == "scan":
        return np.eye(4)
    if name == "camera":
        return _camera(frame, main_camera(frame)).rectified_from_points
    needs = f"which fusion.frame={name} needs"
    if frame.robot_from_points is None:
        raise DataError(
            f"frame {frame.number} does not say where its scan is on the robot, {needs}: give "
            "robot_from_points in a calib.yaml, or TF in a bag; FusionConfig(frame='scan') keeps "
            "the scan's frame",
            code="no-transform",
            fields=(name,),
        )
    if name == "robot":
        return frame.robot_from_points
    if frame.odometry is None:
        message = f"frame {frame.number} has no odometry, {needs}"
        raise DataError(message, code="no-odometry", fields=(name,))
    return np.asarray(frame.odometry @ frame.robot_from_points, dtype=np.float64)


def robot_from_cloud(frame: Frame, config: FusionConfig) -> NDArray[np.float64]:
    """float64 (4, 4): the pose of a frame's cloud on the robot, whose frame is the scan's if it is
    unknown.

    Raises:
        DataError: the transform is not known for this frame.
    """
    robot_from_points = np.eye(4) if frame.robot_from_points is None else frame.robot_from_points
    return robot_from_points @ np.linalg.inv(frame_from_points(frame, config.frame))


def require_up(config: FusionConfig, frame: Frame | None = None) -> None:
    """Raise unless z points up in the clouds, from the scanner or the robot as their origin.

    Args:
        config: how clouds are made.
        frame: whose calibration says how its sensors are mounted; None trusts the configuration.

    Raises:
        ConfigError: clouds in another frame than the scan's or the robot's, or another axis points
            up (code "not-up").
        DataError: the scan's z axis is more than 45 degrees off the robot's, or, where the robot's
            frame is not known, less than 45 degrees off the main camera's line of sight (code
            "not-up").
    """
    if config.frame not in ("scan", "robot") or config.up != "z":
        key, value = ("frame", config.frame) if config.up == "z" else ("up", config.up)
        raise ConfigError(
            f"fusion.{key} is {value}, expected {'scan or robot' if key == 'frame' else 'z'} for a "
            "descriptor that needs clouds about the robot, with z up",
            code="not-up",
            fields=(f"fusion.{key}", value),
        )
    if config.frame == "robot" or frame is None:
        return
    if frame.robot_from_points is not None:
        tilted, of = frame.robot_from_points[2, 2] < _COS_45, "robot_from_points tilts it"
        cure = "fusion.frame=robot turns it up"
    elif (name := main_camera(frame)) in frame.cameras:
        tilted = abs(_line_of_sight(frame.cameras[name])[2]) > _COS_45
        of = f"the {name} camera looks along z"
        cure = "fusion.frame=robot and robot_from_points in a calib.yaml turn it up"
    else:
        _warn_of_optical(frame)
        return
    if tilted:
        raise DataError(
            f"z does not point up in the scan's frame, as {of}: {cure}",
            code="not-up",
            fields=("scan",),
        )


def looks_along_z(points: NDArray[np.float32]) -> bool:
    """Whether a scanner at the origin sees less than 60 degrees off its z axis only.

    Depth cameras do, in their optical frames; other scanners see the ground, walls or both.

    Args:
        points: float32 (N, 3).
    """
    if not len(points):
        return False
    some = points[:: 1 + len(points) // _ENOUGH_POINTS]
    ahead = some[:, 2] > _COS_60 * np.linalg.norm(some, axis=1)
    return bool(ahead.mean() > _NEARLY_ALL)


OPTICAL = (
    "z seems to point ahead instead of up, as in a camera's optical frame (x right, y down, z "
    "ahead)"
)


def _warn_of_optical(frame: Frame) -> None:
    """Warn of a scan whose mounting is unknown, and in which z does not seem to point up."""
    points = np.asarray(frame.points)
    if points.ndim != 2 or points.shape[1] != 3 or not looks_along_z(points):
        return  # what is no cloud is refused where it is used
    text = (
        f"{OPTICAL}: robot_from_points in a calib.yaml (--calib, or in a plain folder) and "
        "fusion.frame=robot turn it up"
    )
    _warn(frame, "%s", text, kind=text)


def _warn(frame: Frame, text: str, *values: object, kind: str = "") -> None:
    """Log a warning of a frame; commands count those of a kind, which is the text by default."""
    extra = {PER_FRAME: kind or text}
    logger.warning(f"frame %d: {text}", frame.number, *values, extra=extra)


def subset(cloud: Cloud, indices: NDArray[np.int64]) -> Cloud:
    """Select points of a cloud by their indices, int64 (M,)."""
    if len(indices) == len(cloud):
        return cloud
    colors = None if cloud.colors is None else cloud.colors[indices]
    intensities = None if cloud.intensities is None else cloud.intensities[indices]
    seconds = None if cloud.seconds is None else cloud.seconds[indices]
    return Cloud(cloud.points[indices], colors, intensities, seconds)


def main_camera(frame: Frame) -> str:
    """The camera that a frame's pictures and its camera frame are of: "left", or else the first."""
    names = [*frame.cameras, *frame.images]
    return "left" if "left" in names or not names else names[0]


def color_cameras(frame: Frame, config: FusionConfig) -> tuple[str, ...]:
    """Names of the cameras that are to colour a frame's scan: the main one, others by name."""
    if config.cameras is not None:
        return config.cameras
    main = main_camera(frame)
    others = {*frame.cameras, *frame.images} - {main}
    left, right = frame.cameras.get("left"), frame.cameras.get("right")
    # Where they look the same way, or nothing is known, they are a stereo pair.
    if main == "left" and (
        left is None or right is None or _line_of_sight(left) @ _line_of_sight(right) > _COS_45
    ):
        others.discard("right")
    return (main, *sorted(others))


def _line_of_sight(camera: Camera) -> NDArray[np.float64]:
    """float64 (3,), of length 1, in the scan's frame."""
    ahead = camera.points_from_rectified[:3, 2]
    return np.asarray(ahead / np.linalg.norm(ahead), dtype=np.float64)


def _lidar_cloud(frame: Frame, config: FusionConfig) -> Cloud:
    """The scan, coloured by its cameras; one that cannot be used is left out, which is logged.

    Raises:
        DataError: none can be used: that of the first one.
    """
    scan = _scan(frame)
    images, projections, problems = [], [], []
    for name in color_cameras(frame, config):
        try:
            image, camera = _image(frame, name), _camera(frame, name)
        except DataError as error:
            problems.append((name, error))
            continue
        images.append(image)
        projections.append(camera.projection_from_points)
    if not images:
        raise problems[0][1]
    for name, problem in problems:
        logger.warning(
            "%s; the scan is coloured without this camera",
            problem,
            extra={PER_FRAME: f"the {name} camera is left out ({problem.code})"},
        )
    if len(images) == 1:
        points, colors, kept = colorize(
            scan.points, images[0], projections[0], interpolation=config.interpolation
        )
    else:
        points, colors, kept, _, _ = colorize_all_round(
            scan.points,
            images,
            projections,
            balance=config.balance,
            interpolation=config.interpolation,
        )
    return replace(subset(scan, kept), points=points, colors=colors)


def _stereo_cloud(frame: Frame, config: FusionConfig) -> Cloud:
    left, right = _image(frame, "left"), _image(frame, "right")
    cameras = _camera(frame, "left"), _camera(frame, "right")
    changes = config.stereo.model_dump(exclude_none=True)
    settings = StereoConfig(preset=config.stereo_preset, **changes)
    points, colors, _ = cloud_from_disparity(
        stereo_disparity(left, right, config=settings),
        left,
        cameras[0].projection,
        cameras[1].projection,
        cloud_from_rectified=cameras[0].points_from_rectified,
        config=settings,
    )
    return Cloud(points, colors)


class ScanCheck(NamedTuple):
    """Numbers of points that few scans have.

    Attributes:
        at_scanner: points at the scanner itself, where some drivers put missing returns.
        distant: points beyond 500 m: the unit may be another one than metres.
    """

    at_scanner: int
    distant: int


def check_scan(points: NDArray[np.float32]) -> ScanCheck:
    """Count the points that few scans have.

    Raises:
        DataError: a tenth of the points are farther away than any LiDAR sees (code "far-points").
    """
    far, distant = 0, 0
    if not np.abs(points).max(initial=0) <= DISTANT_M:
        largest = np.where(np.isfinite(points), np.abs(points), 0).max(axis=1, initial=0)
        far, distant = int((largest > _FARTHEST_M).sum()), int((largest > DISTANT_M).sum())
    if far > 0.1 * len(points):
        raise DataError(
            f"{far} of {len(points)} points are farther than {_FARTHEST_M / 1000:g} km, expected "
            "metres from the scanner: is the data damaged, of another type, unit or frame?",
            code="far-points",
            fields=(str(far), str(len(points))),
        )
    at_scanner = np.logical_and.reduce(points.T == 0)
    return ScanCheck(int(at_scanner.sum()), distant)


def _scan(frame: Frame) -> Cloud:
    """The frame's scan without invalid points."""
    if frame.points is None:
        message = f"frame {frame.number} has no scan{_suggest_source(frame)}"
        raise DataError(message, code="missing-sensor", fields=("points",))
    seconds = frame.point_seconds
    scan = Cloud(frame.points, frame.colors, frame.intensities, seconds)
    valid = drop_invalid(scan.points)
    if scan.colors is not None and np.shape(scan.colors) != (len(scan), 3):
        raise ShapeError(
            f"frame {frame.number}: colors have shape {np.shape(scan.colors)}, expected "
            f"({len(scan)}, 3), one of each point",
            fields=("colors",),
        )
    if scan.intensities is not None and np.shape(scan.intensities) != (len(scan),):
        raise ShapeError(
            f"frame {frame.number}: intensities have shape {np.shape(scan.intensities)}, expected "
            f"({len(scan)},), one of each point",
            fields=("intensities",),
        )
    if seconds is not None and np.shape(seconds) != (len(scan),):
        raise ShapeError(
            f"frame {frame.number}: point_seconds have shape {np.shape(seconds)}, expected "
            f"({len(scan)},), one of each point",
            fields=("point_seconds",),
        )
    found = check_scan(scan.points)
    for count, where in (
        (found.at_scanner, "lie at the scanner (0, 0, 0)"),
        (found.distant, f"lie beyond {DISTANT_M:g} m: expected metres"),
    ):
        if 2 * count > len(scan):
            kind = f"most points {where}"
            _warn(frame, "%d of %d points %s", count, len(scan), where, kind=kind)
    if len(valid) < len(scan):
        dropped = counted(len(scan) - len(valid), "point")
        kind = "points with NaN or infinity are dropped"
        _warn(frame, "dropped %s with NaN or infinity", dropped, kind=kind)
    return subset(scan, valid)


def _camera(frame: Frame, name: str) -> Camera:
    if name not in frame.cameras:
        message = (
            f"frame {frame.number} has no calibration of the {name} camera (a recording takes a "
            f"calib.yaml){_suggest_source(frame)}"
        )
        raise DataError(message, code="no-calibration", fields=(name,))
    return frame.cameras[name]


def _image(frame: Frame, name: str) -> NDArray[np.uint8]:
    if name not in frame.images:
        message = f"frame {frame.number} has no {name} image{_suggest_source(frame)}"
        raise DataError(message, code="missing-sensor", fields=(name,))
    image, size = frame.images[name], _camera(frame, name).size
    if size is not None and size != (image.shape[1], image.shape[0]):
        raise DataError(
            f"frame {frame.number}: the {name} image is {image.shape[1]}x{image.shape[0]}, "
            f"its calibration is for {size[0]}x{size[1]}",
            code="image-size",
            fields=(name,),
        )
    return image


def _suggest_source(frame: Frame) -> str:
    """Name a source for which the frame has all sensors, as the end of a message."""
    if frame.has_points:
        return ": fusion=FusionConfig(source='cloud') takes scans as they are"
    if {"left", "right"} <= set(frame.images):
        return ": fusion=FusionConfig(source='stereo') needs no scans"
    return ""


def _ground_frame(config: FusionConfig) -> CloudFrame:
    """Frame in which the ground is searched: z is up and, for segments, it moves with the robot."""
    if config.frame == "camera":
        return "scan"
    if config.frame == "odometry" and config.ground == "segments":
        return "robot"
    return config.frame


def plane_of(config: FusionConfig) -> GroundPlaneConfig:
    """Parameters of the core's ground plane search in the configured frame."""
    robots = {} if _is_cars(config) else _ROBOT_PLANE
    return GroundPlaneConfig(**robots | config.plane.model_dump(exclude_none=True))


def segments_of(config: FusionConfig) -> GroundSegmentsConfig:
    """Parameters of the core's ground segment search in the configured frame."""
    robots = {} if _is_cars(config) else _ROBOT_SEGMENTS
    return GroundSegmentsConfig(**robots | config.segments.model_dump(exclude_none=True))


def _is_cars(config: FusionConfig) -> bool:
    """Whether defaults are those of a car (scan's frame), not those of a small robot."""
    return _ground_frame(config) == "scan"


def _transform(cloud: Cloud, a_from_b: NDArray[np.float64]) -> Cloud:
    """Transform a cloud from frame b to frame a."""
    if np.array_equal(a_from_b, np.eye(4)):
        return cloud
    # Not a matrix product: BLAS would start all its threads for three columns.
    turned = np.einsum("ij,kj->ik", cloud.points, a_from_b[:3, :3]) + a_from_b[:3, 3]
    return replace(cloud, points=turned.astype(np.float32))


ROBOT_FUSION = FusionConfig(frame="robot", ground="height")
"""Fusion for scenes: clouds in the robot's frame, low points removed (Stastny 2022, 4.3)."""
