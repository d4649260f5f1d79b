# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Messages in, frames out: what a robot runs, and what reading its recordings is built of.

``FrameBuilder`` takes scans, images, calibrations, odometry and transforms as they arrive and
yields each scan as a ``Frame`` with its images and with cameras placed where they were when they
saw them.
"""

import logging
import re
from collections import Counter, deque
from collections.abc import Mapping
from functools import partial

import numpy as np
from numpy.typing import NDArray

from fusionslam import _core
from fusionslam.config import Section, option
from fusionslam.errors import ConfigError, DataError, ShapeError
from fusionslam.messages import CameraInfo, FrameTransforms, Message, Odometry, Picture, Scan
from fusionslam.robot_frames import RobotFrames
from fusionslam.sensors import Camera, Frame
from fusionslam.synchronizer import (
    BUFFER_FULL,
    CLOCK_JUMP,
    NANOSECONDS,
    Pair,
    SyncConfig,
    Synchronizer,
)
from fusionslam.transforms import TransformError

logger = logging.getLogger(__name__)

Matrix = NDArray[np.float64]
Image = NDArray[np.uint8]

NO_TRANSFORM = "no transform"
NO_CAMERA_INFO = "no CameraInfo"
BAD_CALIBRATION = "calibration does not fit"


class OnlineConfig(Section):
    """How messages become frames while they arrive."""

    sync: SyncConfig = option(SyncConfig(), "which image belongs to which scan")
    robot_frame: str = option(
        "", "the robot's frame; empty: that of the odometry, else base_footprint or base_link"
    )
    odometry_frame: str = option(
        "", "the frame that odometry is measured in; empty: that of the odometry, else odom"
    )
    wait: float = option(
        0.5, "how long a scan waits for its transforms and CameraInfo", unit="s", ge=0
    )
    history: float = option(10.0, "how long transforms are kept", unit="s", gt=0)
    extrapolation: float = option(
        0.0, "how far beyond the known transforms a robot's motion is carried on", unit="s", ge=0
    )


def camera_from(info: CameraInfo, camera_from_points: Matrix, name: str = "camera") -> Camera:
    """The rectified camera of a CameraInfo.

    Args:
        info: its projection of zeros, as drivers without rectification send, means K itself.
        camera_from_points: float64 (4, 4), maps points of the scan to the camera's optical frame.
        name: what errors call it: its topic.

    Raises:
        DataError: a camera matrix of zeros, as sent by cameras that were never calibrated, or
            one that no camera can have.
    """
    rectified_from_camera = np.eye(4)
    rectified_from_camera[:3, :3] = info.rectification
    projection = _projection(info, name)
    try:
        return Camera(projection, rectified_from_camera @ np.asarray(camera_from_points), info.size)
    except (DataError, ShapeError) as error:
        raise DataError(f"CameraInfo of {name}: {error}") from error


def rectified(picture: Picture, info: CameraInfo, name: str = "camera") -> Image:
    """The image as the projection of its CameraInfo sees it: without distortion.

    Raises:
        DataError: the image has another size than its CameraInfo says, or a calibration that
            cannot be used.
    """
    _check_size(picture, info, name)
    projection = _projection(info, name)
    same = np.array_equal(projection[:, :3], info.camera_matrix)
    if same and not info.distortion.any() and np.array_equal(info.rectification, np.eye(3)):
        return picture.image
    try:
        return _core.rectify_image(
            picture.image,
            camera_matrix=info.camera_matrix,
            distortion=info.distortion,
            model=info.distortion_model,
            rectification=info.rectification,
            projection=projection,
            size=info.size,
        )
    except (DataError, ConfigError) as error:  # an unknown model is the camera's, no option of ours
        raise DataError(f"CameraInfo of {name}: {error}") from error


def frame_from_pair(
    scan: Scan,
    pictures: Mapping[str, Picture],
    infos: Mapping[str, CameraInfo],
    frames: RobotFrames,
    *,
    index: int = 0,
    still: bool = False,
) -> Frame:
    """A scan and the images that belong to it as a frame.

    Rays without return (NaN) are left out. The images are rectified when first asked for.

    Args:
        pictures: by camera name.
        infos: calibration of each of them.
        frames: where sensors and robot were.
        index: number of the frame.
        still: leave odometry out of it.

    Raises:
        TransformError: something is not known at its time (a DataError).
        DataError: a calibration that cannot be used, or an image of another size.
    """
    cameras = {}
    for name, picture in pictures.items():
        optical = infos[name].frame_id or picture.frame_id
        _check_size(picture, infos[name], name)
        moved = frames.camera_from_points(
            optical, picture.stamp_ns, scan.frame_id, scan.stamp_ns, still=still
        )
        cameras[name] = camera_from(infos[name], moved, name)
    valid = np.isfinite(scan.points).all(axis=1)
    return Frame(
        index=index,
        stamp_ns=scan.stamp_ns,
        points=scan.points if valid.all() else scan.points[valid],
        colors=None if scan.colors is None else scan.colors[valid],
        images={name: partial(rectified, p, infos[name], name) for name, p in pictures.items()},
        cameras=cameras,
        odometry=None if still else frames.odometry_from_robot(scan.stamp_ns),
        robot_from_points=frames.robot_from(scan.frame_id, scan.stamp_ns),
    )


class FrameBuilder:
    """Makes frames of messages, in bounded memory and without ever stopping on bad ones.

    A scan is out once its images are decided (``Synchronizer``) and its transforms and CameraInfo
    are there; it waits for those up to ``wait`` seconds of the newest stamp. For the sensor
    ``scans``, always: added = frames + dropped + waiting.

    Args:
        config: limits and names.
        cameras: which cameras every frame needs.

    Attributes:
        sync: the synchroniser, with its counts.
        robot: where sensors and robot were.
        frames: number of frames so far.
        refused: messages of wrong content by type: transforms that form a loop, ...
        still: number of frames for whose time odometry was not known.
    """

    def __init__(
        self, config: OnlineConfig | None = None, *, cameras: tuple[str, ...] = ("left",)
    ) -> None:
        self.config = config or OnlineConfig()
        self.sync = Synchronizer(self.config.sync, cameras=cameras)
        self.robot = RobotFrames(
            history_s=self.config.history,
            extrapolation_s=self.config.extrapolation,
            robot=self.config.robot_frame,
            odometry=self.config.odometry_frame,
        )
        self.frames = self.still = 0
        self.refused: Counter[str] = Counter()
        self._infos: dict[str, CameraInfo] = {}
        self._pending: deque[Pair] = deque()
        self._given_up: Counter[tuple[str, str]] = Counter()
        self._newest_ns: int | None = None
        self._said: set[tuple[str, str]] = set()

    @property
    def dropped(self) -> Counter[tuple[str, str]]:
        """Messages that came to nothing, by (sensor, reason)."""
        return self.sync.dropped + self._given_up

    @property
    def waiting(self) -> dict[str, int]:
        """By sensor, messages that are not decided yet."""
        waiting = self.sync.waiting
        return waiting | {self.sync.scans: waiting[self.sync.scans] + len(self._pending)}

    def process(self, message: Message, camera: str = "left") -> list[Frame]:
        """Take a message and return the frames that it completes, by rising stamp.

        Args:
            message: of any sensor. Wrong content is refused, counted and logged once.
            camera: which camera an image or a CameraInfo is of.

        Raises:
            ConfigError: an image of a camera that was not named when the object was made.
        """
        if isinstance(message, CameraInfo):
            self._infos[camera] = message
        elif isinstance(message, Scan):
            self._synchronise(self.sync.scans, message)
        elif isinstance(message, Picture):
            self._synchronise(camera, message)
        else:
            self._move(message)
        return self._complete()

    def flush(self) -> list[Frame]:
        """The frames of all that waits: nothing more will come."""
        self._pending.extend(self.sync.flush())
        return self._complete(final=True)

    def _synchronise(self, sensor: str, message: Scan | Picture) -> None:
        jumps = self.sync.jumps
        pairs = self.sync.add(sensor, message.stamp_ns, message)
        if self.sync.jumps > jumps:
            self._start_anew()
        self._pending.extend(pairs)
        self._see(message.stamp_ns)
        if len(self._pending) > self.config.sync.buffer:
            self._pending.popleft()
            self._give_up(BUFFER_FULL, "too many scans wait")

    def _move(self, message: FrameTransforms | Odometry) -> None:
        if self.robot.goes_back(message, round(self.config.sync.jump * NANOSECONDS)):
            self.robot.forget_moving()
            self._start_anew()
        try:
            self.robot.add(message)
        except DataError as error:
            self.refused[type(message).__name__] += 1
            self._say(type(message).__name__, str(error))
        else:
            for stamp_ns in _moving_stamps(message):
                self._see(stamp_ns)

    def _see(self, stamp_ns: int) -> None:
        self._newest_ns = stamp_ns if self._newest_ns is None else max(self._newest_ns, stamp_ns)

    def _start_anew(self) -> None:
        """The clock went back: what waits belongs to another time."""
        self._newest_ns = None
        while self._pending:
            self._pending.popleft()
            self._give_up(CLOCK_JUMP, "the clock went back")

    def _complete(self, *, final: bool = False) -> list[Frame]:
        frames = []
        while self._pending:
            pair = self._pending[0]
            late = final or self._waited(pair) > self.config.wait * NANOSECONDS
            try:
                frame = self._frame(pair, late)
            except _NotYetError:
                break
            self._pending.popleft()
            if frame is not None:
                self.frames += 1
                frames.append(frame)
        return frames

    def _waited(self, pair: Pair) -> int:
        return 0 if self._newest_ns is None else self._newest_ns - pair.stamp_ns

    def _frame(self, pair: Pair, late: bool) -> Frame | None:
        """The pair's frame, or None if it had to be given up. Raises _NotYetError."""
        missing = [name for name in pair.images if name not in self._infos]
        if missing and not late:
            raise _NotYetError
        if missing:
            self._give_up(NO_CAMERA_INFO, f"none arrived for {', '.join(missing)}")
            return None
        try:
            return self._placed(pair, late)
        except TransformError as error:
            if error.may_come and not late:
                raise _NotYetError from error
            self._give_up(NO_TRANSFORM, str(error))
        except DataError as error:
            self._give_up(BAD_CALIBRATION, str(error))
        return None

    def _placed(self, pair: Pair, late: bool) -> Frame:
        """Without odometry where that is all that is missing."""
        pictures = {name: image.item for name, image in pair.images.items()}
        make = partial(
            frame_from_pair, pair.item, pictures, self._infos, self.robot, index=self.frames
        )
        try:
            return make()
        except TransformError as error:
            if error.may_come and not late:
                raise
            frame = make(still=True)
            self.still += 1
            self._say("odometry", str(error))
            return frame

    def _give_up(self, reason: str, why: str) -> None:
        self._given_up[self.sync.scans, reason] += 1
        self._say(reason, why)

    def _say(self, reason: str, why: str) -> None:
        # Numbers differ from message to message, the cause does not.
        cause = reason, re.sub(r"[-\d.]+", "#", why)
        level = logging.DEBUG if cause in self._said else logging.WARNING
        self._said.add(cause)
        logger.log(level, "%s: %s", reason, why)


class _NotYetError(Exception):
    """Something that a pair needs may still arrive."""


def _moving_stamps(message: FrameTransforms | Odometry) -> list[int]:
    if isinstance(message, Odometry):
        return [message.stamp_ns]
    return [each.stamp_ns for each in message.transforms if not each.static]


def _projection(info: CameraInfo, name: str) -> Matrix:
    if not np.any(info.camera_matrix):
        raise DataError(
            f"CameraInfo of {name} has a camera matrix K of zeros: calibrate the camera"
        )
    if np.any(info.projection):
        return info.projection
    return np.hstack([info.camera_matrix, np.zeros((3, 1))])


def _check_size(picture: Picture, info: CameraInfo, name: str) -> None:
    size = picture.image.shape[1], picture.image.shape[0]
    if size != tuple(info.size):
        raise DataError(
            f"the image of {name} is {size[0]}x{size[1]}, its CameraInfo says "
            f"{info.size[0]}x{info.size[1]}"
        )
