# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Record data as a ``SceneSet``: each frame fused, without ground, in the robot's frame."""

import logging
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from fusionslam.base.arrays import Matrix
from fusionslam.base.parallel import ordered_results
from fusionslam.base.progress import Progress, reported
from fusionslam.datasets.range_recording import RangeRecording, RecordingConfig
from fusionslam.descriptors import (
    DescriptorConfig,
    describe,
    find_descriptor,
    for_clouds,
    for_sequence,
    length_of,
)
from fusionslam.errors import DataError
from fusionslam.fusion import ROBOT_FUSION, FusionConfig, fuse
from fusionslam.geometry.se2 import places_of
from fusionslam.pipelines.frame_check import readable_frames
from fusionslam.pipelines.recording import SceneRecording, name_frame, warn_of_odometry
from fusionslam.sensors.frame import Cloud
from fusionslam.views.scene_set import CloudArray, SceneSet

if TYPE_CHECKING:
    from fusionslam.datasets import Dataset

logger = logging.getLogger(__name__)


def record_scenes(
    data: "Dataset",
    *,
    fusion: FusionConfig = ROBOT_FUSION,
    recording: RecordingConfig | None = None,
    features: Sequence[str] = (),
    descriptors: DescriptorConfig | None = None,
    jobs: int = 1,
    source: dict[str, Any] | None = None,
    bad_frames: str = "error",
    progress: Progress | None = None,
) -> SceneSet:
    """Record every scan as a coloured cloud, with its time and ground-truth pose.

    Scans without remaining points are kept, and marked as empty.

    Args:
        data: the result of ``Recording.open``; a scene set is returned as it is.
        fusion: how frames of a dataset become clouds.
        recording: how scans of a ``RangeRecording`` become clouds.
        features: names of descriptors to compute as well.
        descriptors: configuration of the descriptors.
        jobs: number of frames processed in parallel; does not change the result.
        source: information to store about the origin of the data.
        bad_frames: "error" fails on a frame that cannot be read; "skip" leaves it out and logs it.
        progress: called with (scans done, total scans).

    Raises:
        DataError: a frame cannot be read or fused, or has no colours; the message names it.
        ConfigError: an unknown descriptor, or one that is not for clouds in this frame.
    """
    for name in features:
        find_descriptor(name)
    if isinstance(data, SceneRecording):
        return data.scenes
    settings = descriptors or DescriptorConfig()
    ranges = FusionConfig(frame=(recording or RecordingConfig()).frame)
    for name in features:
        for_clouds(settings, name, ranges if isinstance(data, RangeRecording) else fusion)
    if isinstance(data, RangeRecording):
        config = recording or RecordingConfig()
        measured = data.odometry(config)
        indices = reported(range(len(data)), progress, len(data))
        clouds = [data.cloud(index, config, measured) for index in indices]
        scenes = _fields(data, clouds, config.frame, data.places)
    else:
        data = readable_frames(data, bad_frames, jobs=jobs)
        scenes = _of_dataset(data, fusion, jobs, progress)
    rows = {
        name: _feature(scenes, name, for_clouds(settings, name, ROBOT_FUSION)) for name in features
    }
    return SceneSet(**scenes, features=rows, source=source or {})


def record_cloud(
    data: "Dataset",
    number: int,
    *,
    fusion: FusionConfig = ROBOT_FUSION,
    recording: RecordingConfig | None = None,
) -> Cloud:
    """Return the coloured cloud of one scan as ``record_scenes`` makes it, without the others.

    Args:
        data: as for ``record_scenes``.
        number: of the scan, in the numbering of the data.
        fusion, recording: as for ``record_scenes``.

    Raises:
        DataError: there is no such scan, there are no clouds, or the frame cannot be read or
            fused.
    """
    found = np.flatnonzero(data.numbers == number)
    if not len(found):
        known = f"numbered {data.numbers[0]} to {data.numbers[-1]}"
        raise DataError(f"{data.name} has no scan {number}; its scans are {known}", code="no-scan")
    row = int(found[0])
    if isinstance(data, RangeRecording):
        config = recording or RecordingConfig()
        return data.cloud(row, config, data.odometry(config))
    if isinstance(data, SceneRecording):
        return data.whole_cloud(row)
    return fuse(data[row], fusion)


def _of_dataset(
    data: "Dataset", config: FusionConfig, jobs: int, progress: Progress | None
) -> dict[str, Any]:
    clouds: list[Cloud] = []
    odometry = np.full((len(data), 3), np.nan)

    def fuse_frame(index: int) -> tuple[Cloud, Matrix | None]:
        with name_frame(data, index, can_skip=True):
            frame = data[index]
            return fuse(frame, config), frame.odometry

    with ordered_results(fuse_frame, range(len(data)), jobs) as fused:
        for cloud, measured in reported(fused, progress, len(data)):
            if measured is not None:
                odometry[len(clouds)] = places_of(measured[None])[0]
            clouds.append(cloud)
    warn_of_odometry(data)
    true = data.true_poses
    poses = None if true is None else places_of(true @ data.body_from_robot)
    fields = _fields(data, clouds, config.frame, poses)
    return fields if np.isnan(odometry).all() else {**fields, "odometry": odometry}


def _fields(
    data: "Dataset", clouds: list[Cloud], frame: str, poses: NDArray[np.float64] | None
) -> dict[str, Any]:
    stored = CloudArray.of(clouds)
    return {
        "name": data.name,
        "stamps_ns": data.stamps_ns,
        "numbers": data.numbers,
        "empty": stored.sizes == 0,
        "frame": frame,
        "poses": poses,
        "clouds": stored,
    }


def _feature(scenes: dict[str, Any], name: str, config: DescriptorConfig) -> NDArray[np.float32]:
    """float32 (n, D); NaN where a cloud cannot be described, which is logged."""
    clouds: CloudArray = scenes["clouds"]
    rows = np.full((len(clouds), length_of(name, config)), np.nan, np.float32)
    if find_descriptor(name).fits_first and len(clouds.points):
        config = for_sequence(config, [name], clouds[int(np.flatnonzero(clouds.sizes)[0])])
    failed = []
    for index in range(len(clouds)):
        try:
            rows[index] = describe(clouds[index], name, config)
        except DataError as error:
            failed.append((index, str(error)))
    if failed:
        numbers = [int(scenes["numbers"][index]) for index, _ in failed]
        logger.warning("%d scans cannot be described with %s: %s", len(failed), name, failed[0][1])
        logger.info("scans without %s: %s", name, numbers)
    return rows
