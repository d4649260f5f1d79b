# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Frames to coloured clouds: LiDAR and camera, or a stereo pair; ground and density.

The stages are C++ (``fusionslam.colorize``, ``stereo_disparity``, ...); this module chooses
between them (Perdomo 2019, section 3.3; Stastny 2022, section 4.3).
"""

import logging
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from fusionslam import _core, meanings
from fusionslam.config import Section, core_section, option
from fusionslam.errors import DataError
from fusionslam.sensors import Camera, Cloud, Frame

if TYPE_CHECKING:

    class StereoSection(Section): ...

    class PlaneSection(Section): ...

else:
    StereoSection = core_section("StereoSection", _core.StereoConfig, optional=True)
    PlaneSection = core_section("PlaneSection", _core.GroundPlaneConfig)

logger = logging.getLogger(__name__)

Source = Literal["lidar", "stereo", "cloud"]
SOURCES: tuple[Source, ...] = ("lidar", "stereo", "cloud")


class FusionConfig(Section):
    """How a frame becomes a coloured cloud."""

    source: Source = option(
        "lidar",
        meanings.SOURCE,
    )
    interpolation: Literal["nearest", "bilinear"] = option("nearest", "how a pixel is read")
    ground: Literal["none", "height", "plane"] = option("none", "how the ground is removed")
    ground_height: float = option(
        -1.4, "ground: height drops points not above this, in the scan's frame", unit="m"
    )
    up: Literal["x", "y", "z", "-x", "-y", "-z"] = option(
        "z", "which way is up in the scan's frame"
    )
    voxel: float = option(0.0, "one point a cube of this size; 0 is off", unit="m", ge=0)
    plane: PlaneSection = option(PlaneSection(), "ground: plane, found by RANSAC")
    stereo_preset: Literal["image_undistort", "sgbm"] = option(
        "image_undistort", "StereoBM as in Perdomo 2019, or StereoSGBM: slower, denser"
    )
    stereo: StereoSection = option(StereoSection(), "single values instead of the preset's")


def fuse(frame: Frame, config: FusionConfig | None = None) -> Cloud:
    """The coloured cloud of a frame, in the frame of its scan (stereo: the same frame).

    Points with NaN or infinity are dropped and their number is logged.

    Raises:
        DataError: the frame lacks a sensor or calibration that the source needs; the message
            names it. Or an image of another size than the calibration says.
    """
    config = config or FusionConfig()
    make = {"lidar": _lidar_cloud, "stereo": _stereo_cloud, "cloud": _plain_cloud}[config.source]
    cloud = _without_ground(make(frame, config), config)
    return _downsampled(cloud, config.voxel) if config.voxel > 0 else cloud


def subset(cloud: Cloud, indices: NDArray[np.int64]) -> Cloud:
    """The points of a cloud with these indices, int64 (M,)."""
    if len(indices) == len(cloud):
        return cloud
    return Cloud(cloud.points[indices], None if cloud.colors is None else cloud.colors[indices])


def _lidar_cloud(frame: Frame, config: FusionConfig) -> Cloud:
    scan, camera, image = _scan(frame), _camera(frame, "left"), _image(frame, "left")
    points, colors, _ = _core.colorize(
        scan.points, image, camera.projection_from_points, interpolation=config.interpolation
    )
    return Cloud(points, colors)


def _stereo_cloud(frame: Frame, config: FusionConfig) -> Cloud:
    left, right = _image(frame, "left"), _image(frame, "right")
    cameras = _camera(frame, "left"), _camera(frame, "right")
    changes = config.stereo.model_dump(exclude_none=True)
    settings = _core.StereoConfig(preset=config.stereo_preset, **changes)
    points, colors, _ = _core.cloud_from_disparity(
        _core.stereo_disparity(left, right, config=settings),
        left,
        cameras[0].projection,
        cameras[1].projection,
        cloud_from_rectified=cameras[0].points_from_rectified,
        config=settings,
    )
    return Cloud(points, colors)


def _plain_cloud(frame: Frame, config: FusionConfig) -> Cloud:
    return _scan(frame)


def _scan(frame: Frame) -> Cloud:
    """The frame's scan without invalid points."""
    if frame.points is None:
        raise DataError(f"frame {frame.index} has no scan, which this source needs")
    scan = Cloud(frame.points, frame.colors)
    valid = _core.drop_invalid(scan.points)
    if len(valid) < len(scan):
        dropped = len(scan) - len(valid)
        logger.warning("frame %d: dropped %d points with NaN or infinity", frame.index, dropped)
    return subset(scan, valid)


def _camera(frame: Frame, name: str) -> Camera:
    if name not in frame.cameras:
        raise DataError(f"frame {frame.index} has no calibration of the {name} camera")
    return frame.cameras[name]


def _image(frame: Frame, name: str) -> NDArray[np.uint8]:
    if name not in frame.images:
        raise DataError(f"frame {frame.index} has no {name} image, which this source needs")
    image, size = frame.images[name], _camera(frame, name).size
    if size is not None and size != (image.shape[1], image.shape[0]):
        raise DataError(
            f"frame {frame.index}: the {name} image is {image.shape[1]}x{image.shape[0]}, "
            f"its calibration is for {size[0]}x{size[1]}"
        )
    return image


def _without_ground(cloud: Cloud, config: FusionConfig) -> Cloud:
    if config.ground == "none":
        return cloud
    if config.ground == "height":
        kept = _core.above_height(cloud.points, config.ground_height, up=config.up)
    else:
        settings = _core.GroundPlaneConfig(**config.plane.model_dump())
        kept, _ = _core.remove_ground_plane(cloud.points, up=config.up, config=settings)
    return subset(cloud, kept)


def _downsampled(cloud: Cloud, size: float) -> Cloud:
    points, colors, _ = _core.voxel_downsample(cloud.points, cloud.colors, size=size)
    return Cloud(points, None if cloud.colors is None else colors)
