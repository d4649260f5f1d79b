# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Write the coloured clouds of a recording as a plain folder that ``open_dataset`` can read."""

import logging
import os
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from fusionslam.base.arrays import Matrix
from fusionslam.base.files import write_file
from fusionslam.base.parallel import ordered_results
from fusionslam.base.progress import Progress, reported
from fusionslam.datasets import write_cloud, write_poses_tum
from fusionslam.datasets.calibration import ON_ROBOT
from fusionslam.datasets.pose_files import write_times
from fusionslam.errors import ConfigError, DataError
from fusionslam.fusion import FusionConfig, frame_from_points, fuse
from fusionslam.pipelines.frame_check import readable_frames
from fusionslam.pipelines.recording import Recording, body_from_clouds, name_frame, warn_of_mistakes
from fusionslam.pipelines.results import Work, claim, refuse_input

if TYPE_CHECKING:
    from fusionslam.datasets import Dataset

logger = logging.getLogger(__name__)

FORMATS = ("ply", "pcd", "bin")
_POSES = ("poses.txt", "odometry.txt")
# Most frames that a warning names.
_NAMED = 20


def write_clouds(
    recording: Recording,
    folder: str | os.PathLike[str],
    config: FusionConfig,
    *,
    format: str = "ply",
    jobs: int = 1,
    command: str = "",
    bad_frames: str = "error",
    progress: Progress | None = None,
) -> int:
    """Write ``clouds/NNNNNN.<format>``, times.txt and, if known, the poses of the clouds.

    calib.yaml says where the clouds are on the robot, if that is known and fixed.

    Files have the numbers of the dataset's frames. Existing clouds are kept, so that an
    interrupted call resumes. Format bin drops the colours.

    Args:
        recording: the data.
        folder: output folder.
        config: how frames become clouds.
        format: one of ``FORMATS``.
        jobs: number of frames processed in parallel.
        command: the command line to store with the results.
        bad_frames: "error" fails on a frame that cannot be read; "skip" leaves it out and logs it.
        progress: called with (frames done, total frames).

    Returns:
        The number of frames.

    Raises:
        DataError: a frame cannot be read or fused, or the folder cannot be written, holds other
            clouds or is the recording itself. ConfigError: unknown format.
    """
    if format not in FORMATS:
        raise ConfigError(f"format is {format!r}, expected one of {', '.join(FORMATS)}")
    root = Path(folder).expanduser()
    refuse_input(recording, root)
    _refuse_foreign(root)
    dataset = readable_frames(recording.open(config.source), bad_frames, jobs=jobs)
    about = {
        "fusion": config.model_dump(mode="json"),
        "format": format,
        # Clouds are numbered from 0 despite gaps, so other frames would be other clouds.
        "frames": dataset.numbers.tolist(),
    }
    claim(root, Work(recording, dataset.name, command, about=about))
    _write_texts(root, dataset, config)

    def write(index: int) -> bool:
        """Write a cloud unless it is there already; tell whether it has no points."""
        path = root / "clouds" / f"{index:06d}.{format}"
        if path.exists():
            return False
        with name_frame(dataset, index, can_skip=True):
            cloud = fuse(dataset[index], config)
            write_cloud(path, cloud)
        return not len(cloud)

    empty = []
    with ordered_results(write, range(len(dataset)), jobs) as written:
        for row, is_empty in enumerate(reported(written, progress, len(dataset))):
            empty += [row] * is_empty
    log_empty(dataset, empty)
    warn_of_mistakes(dataset, config.source)
    return len(dataset)


def log_empty(dataset: "Dataset", rows: list[int]) -> None:
    """Warn of frames that gave a cloud without points, by their numbers in the recording."""
    if not rows:
        return
    numbers = [str(number) for number in dataset.numbers[rows[:_NAMED]]]
    more = ", ..." if len(rows) > _NAMED else ""
    logger.warning(
        "%s: %d of %d clouds have no points: frame%s %s",
        dataset.name,
        len(rows),
        len(dataset),
        "s" if len(rows) > 1 else "",
        ", ".join(numbers) + more,
    )


def _refuse_foreign(root: Path) -> None:
    """Raise DataError if files not written by an earlier call have the names of ours."""
    if Work.load(root) is not None:
        return
    for name in ("clouds", "times.txt", *_POSES, "calib.yaml"):
        if (root / name).exists():
            raise DataError(
                f"{root} holds {name}, which no earlier fuse wrote: choose another folder",
                code="other-results",
                fields=(str(root), name),
            )


def _write_texts(root: Path, dataset: "Dataset", config: FusionConfig) -> None:
    write_times(root / "times.txt", dataset.stamps_ns)
    # Where the folder is read, poses.txt counts as true and odometry.txt as the robot's motion,
    # which clouds in the frame of odometry do not have.
    true, drifting = _POSES
    name = drifting if dataset.true_poses is None else true
    if name == true or config.frame != "odometry":
        poses = cloud_poses(dataset, config)
        if poses is not None:
            write_poses_tum(root / name, dataset.stamps_ns, poses)
    place = _place_on_robot(dataset, config)
    if place is not None:
        write_file(root / "calib.yaml", f"{ON_ROBOT}: {place.ravel().tolist()}\n")


def _place_on_robot(dataset: "Dataset", config: FusionConfig) -> Matrix | None:
    """float64 (4, 4): robot_from_cloud; None if it is unknown or differs between frames."""
    if config.frame == "odometry":
        return None
    places = []
    for index in range(len(dataset)):
        frame = dataset[index]
        if frame.robot_from_points is None:
            return None
        cloud_from_points = frame_from_points(frame, config.frame)
        places.append(frame.robot_from_points @ np.linalg.inv(cloud_from_points))
        if not np.allclose(places[0], places[-1], rtol=0, atol=1e-9):
            return None
    return places[0]


def cloud_poses(dataset: "Dataset", config: FusionConfig) -> NDArray[np.float64] | None:
    """float64 (N, 4, 4): world_from_cloud for the frame of the clouds; None without poses.

    Raises:
        DataError: a frame does not know the pose of its cloud's frame.
    """
    if dataset.poses is None:
        return None
    if config.frame == "odometry":
        logger.warning(
            "the poses written say where odometry begins, as the clouds lie in it: "
            "loops cannot be judged by it"
        )
    if dataset.body_from_points is None:  # then the poses are taken to be those of the points
        dataset = replace(dataset, body_from_points=np.eye(4))
    places = body_from_clouds(dataset, config)
    assert dataset.poses is not None and places is not None
    return np.asarray(dataset.poses @ places, dtype=np.float64)
