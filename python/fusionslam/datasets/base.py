# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""``Dataset``: the frames of one recording, whatever its storage format."""

import functools
import operator
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum
from pathlib import Path
from typing import Any, Self, overload

import numpy as np
from numpy.typing import NDArray

from fusionslam.base.arrays import Image, Matrix
from fusionslam.base.texts import counted
from fusionslam.datasets.cloud_files import image_size, read_cloud, read_image
from fusionslam.datasets.pose_files import (
    check_same_time,
    check_times,
    read_poses_tum,
    read_timestamps,
)
from fusionslam.datasets.streams import Stream
from fusionslam.errors import DataError, one_line
from fusionslam.sensors.frame import Camera, Cloud, Frame
from fusionslam.sensors.image_series import ImageSeries
from fusionslam.sensors.messages import Fix, Imu, Odometry

CAMERA_FROM_ROBOT_AXES: Matrix = np.array(
    [[0.0, -1, 0, 0], [0, 0, -1, 0], [1, 0, 0, 0], [0, 0, 0, 1]]
)
"""Maps x ahead, y left, z up to a camera's z ahead, x right, y down."""
Z_UP = (1.0, -1.0, -1.0)
"""Signs of x, y, z that turn a body with y to the right and z down: y to the left, z up."""


class PosesOrigin(Enum):
    """Origin of a dataset's poses."""

    NONE = "none"
    FILE = "file"
    TRUTH = "truth topic"
    ODOMETRY = "odometry"


class OdometryOrigin(Enum):
    """Origin of the odometry of a dataset's frames."""

    NONE = "none"
    TOPIC = "topic"
    TF = "TF"


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Dataset(ABC):
    """Frames of one recording, ordered by number and loaded on access.

    ``dataset[i]`` is the i-th frame present (its ``index`` is i, its number in the recording is
    ``dataset.numbers[i]``); iterating yields all of them. ``dataset[a:b]`` is a dataset of these
    frames, whose indices begin with 0 again.

    Attributes:
        kind: name of its kind, as in ``open_dataset(kind=...)``, or "scenes".
        name: for display, such as "KITTI odometry 06".
        root: the folder or file of the recording.
        numbers: int64 (N), frame numbers as in the file names; there may be gaps.
        stamps_ns: int64 (N), nanoseconds.
        pose_frame: the body that the poses describe.
        body_from_points: float64 (4, 4), maps points of the scan to that body; None if unknown.
        body_is_camera: whether that body is a camera, z ahead and y down, instead of a robot or a
            scanner, x ahead and z up.
        poses: float64 (N, 4, 4), world_from_body, of ``poses_origin``; None if there are none.
        origin: origin of the poses, if there are any.
        truth_topic: topic of ground truth poses, whether or not ``poses`` come from it; None if
            absent.
        odometry_topic: topic of odometry messages, or name of the file of odometry; None if absent.
        odometry_origin: origin of the frames' odometry.
        cameras: calibration by camera name; the first frame's if each frame has its own.
        gaps: numbers of the incomplete frames, which were left out.
        recorded: number of frames of the whole recording, of which some may be missing here; None
            if unknown.
    """

    kind: str
    name: str
    root: Path
    numbers: NDArray[np.int64]
    stamps_ns: NDArray[np.int64]
    pose_frame: str
    body_from_points: NDArray[np.float64] | None = None
    body_is_camera: bool = False
    poses: NDArray[np.float64] | None = None
    origin: PosesOrigin = PosesOrigin.FILE
    truth_topic: str | None = None
    odometry_topic: str | None = None
    odometry_origin: OdometryOrigin = OdometryOrigin.NONE
    cameras: Mapping[str, Camera] = field(default_factory=dict)
    gaps: Sequence[int] = ()
    recorded: int | None = None

    @property
    def short_name(self) -> str:
        """The recording's name without the options, such as topics, that it was opened with."""
        return self.name

    @property
    def poses_origin(self) -> PosesOrigin:
        """Origin of the poses."""
        return PosesOrigin.NONE if self.poses is None else self.origin

    @property
    def true_poses(self) -> Matrix | None:
        """The poses, unless they are odometry, which drifts: what results are judged by."""
        return None if self.poses_origin is PosesOrigin.ODOMETRY else self.poses

    @property
    def body_from_robot(self) -> Matrix:
        """float64 (4, 4): maps the robot's frame, x ahead and z up, to the body of the poses.

        Where the data say only where the scanner is, its frame is the robot's. Where they say
        nothing of a camera, the robot is where the camera is.
        """
        if self.body_from_points is None:
            return CAMERA_FROM_ROBOT_AXES if self.body_is_camera else np.eye(4)
        robot_from_points = self[0].robot_from_points
        if robot_from_points is None:
            return self.body_from_points
        return np.asarray(self.body_from_points @ np.linalg.inv(robot_from_points))

    def motion(self, role: str) -> list[Odometry]:
        """Messages of role "odometry" or "truth", by stamp. Raises DataError if there are none."""
        raise DataError(f"{self.name} has no {role} messages", code="no-messages", fields=(role,))

    def imu_messages(self) -> Iterator[Imu]:
        """What an IMU says, as it was recorded; nothing where there is none."""
        return iter(())

    def fixes(self) -> Iterator[Fix]:
        """What a satellite receiver says, as it was recorded; nothing where there is none."""
        return iter(())

    def robot_from_antenna(self) -> Matrix | None:
        """float64 (4, 4): the receiver's antenna in the robot's frame; None if that is unknown."""
        return None

    def points_from_imu(self) -> Matrix | None:
        """float64 (4, 4): where the IMU is in the frame of the scans; None if that is unknown."""
        return None

    @property
    def points_frame(self) -> str:
        """Name of the scans' frame; "" where the data do not name it."""
        return ""

    def as_measured(self) -> Self:
        """The dataset with scans in which the motion of the scanner is not undone."""
        return self

    def of_leader(self) -> Self:
        """The dataset with the scans of its leading scanner alone."""
        return self

    @property
    @abstractmethod
    def counts(self) -> dict[str, int]:
        """Number of scans or images by sensor, including those of frames that were left out."""

    @abstractmethod
    def files(self) -> list[Path]:
        """Files that the frames are read from; results are out of date if one of these is newer."""

    def file_of(self, index: int) -> Path | None:
        """File of a frame's scan, or else of its image; None if frames have no files."""
        return None

    @abstractmethod
    def content(self, sensor: str) -> str:
        """Summary of a sensor's data, for display."""

    @abstractmethod
    def sensor_stamps(self, sensor: str) -> NDArray[np.int64] | None:
        """A sensor's own stamps, int64 (M), of the first M frames; None if it has none."""

    @abstractmethod
    def _frame(self, index: int) -> Frame:
        """Read the frame of a valid index."""

    @property
    def sensors(self) -> tuple[str, ...]:
        """The sensors that every frame has: some of "points", "left", "right".

        Further cameras are in ``cameras`` and ``counts``; a frame may lack one of them.
        """
        return tuple(self.counts)

    @property
    def has_points(self) -> bool:
        """Whether the frames have scans."""
        return "points" in self.sensors

    @property
    def has_stereo(self) -> bool:
        """Whether the frames have both images of a stereo pair."""
        return "left" in self.sensors and "right" in self.sensors

    def camera_images(self) -> ImageSeries | None:
        """The left camera's images, one per frame, without poses; None without such a camera."""
        if "left" not in self.sensors:
            return None
        return ImageSeries(
            self.stamps_ns / 1e9,
            None,
            lambda index: self[index].images["left"],
            "images of the recording",
            camera=self.cameras.get("left"),
        )

    def __len__(self) -> int:
        return len(self.numbers)

    def __iter__(self) -> Iterator[Frame]:
        return (self[i] for i in range(len(self)))

    @overload
    def __getitem__(self, index: int) -> Frame: ...

    @overload
    def __getitem__(self, index: slice) -> Self: ...

    def __getitem__(self, index: int | slice) -> Frame | Self:
        """The i-th frame present; negative counts from the end. Of a slice, a dataset.

        Reads no scan and no image.

        Raises:
            IndexError: there is no such frame.
            DataError: its calibration cannot be read, or a slice runs backwards. A scan or an
                image that cannot be read raises on first access.
        """
        if isinstance(index, slice):
            return self.only(range(len(self))[index])
        return self._frame(self._row(index))

    def _row(self, index: int) -> int:
        """The index counted from the beginning. Raises IndexError if there is no such frame."""
        row = operator.index(index)
        if not -len(self) <= row < len(self):
            raise IndexError(f"{self.name} has no frame {row}: expected 0 to {len(self) - 1}")
        return row % len(self)

    def only(self, rows: Sequence[int]) -> Self:
        """The dataset of the frames with these indices, which must rise. Reads no frame.

        ``gaps`` stay those of the recording, and ``counts`` those of its sensors.

        Raises:
            IndexError: there is no such frame.
            DataError: the indices do not rise.
        """
        kept = np.asarray([self._row(row) for row in rows], dtype=np.int64)
        if (np.diff(kept) <= 0).any():
            message = f"{self.name}: the indices of frames must rise, as stamps do"
            raise DataError(message, code="frame-order", fields=(self.name,))
        poses = None if self.poses is None else self.poses[kept]
        numbers, stamps_ns = self.numbers[kept], self.stamps_ns[kept]
        own = self._only(kept)
        return replace(self, numbers=numbers, stamps_ns=stamps_ns, poses=poses, **own)

    def _only(self, rows: NDArray[np.int64]) -> dict[str, Any]:
        """The attributes of a subclass that change with the frames, for those of some rows."""
        return {}

    def __repr__(self) -> str:
        sensors = ", ".join(self.sensors)
        count = counted(len(self), "frame")
        return f"<{type(self).__name__} {self.kind} {self.root}: {count} of {sensors}>"


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class FileDataset(Dataset):
    """A recording with one file per scan and per image.

    Attributes:
        streams: the files of each sensor in use, which every frame has: "points", "left", "right".
        surround: the images of further cameras, which some frames may lack.
        frame_cameras: reads the calibration of one frame, for data where each has its own.
        robot_from_points: float64 (4, 4), where the scanner is on the robot; None if unknown.
        odometry: file of TUM poses by odometry, of the body of the poses; None if there is none.
        poses_file: file or folder that the poses are from; None if there is none.
        read_scan: reads the file of a scan.
    """

    streams: Mapping[str, Stream]
    surround: Mapping[str, Stream] = field(default_factory=dict)
    frame_cameras: Callable[[int], Mapping[str, Camera]] | None = None
    robot_from_points: Matrix | None = None
    odometry: Path | None = None
    poses_file: Path | None = None
    read_scan: Callable[[Path], Cloud] = read_cloud

    def motion(self, role: str) -> list[Odometry]:
        """The poses of the file of odometry, of the robot, by stamp; without velocities.

        Raises:
            DataError: there is no such file, it cannot be read, or it is of another time than the
                frames.
        """
        if role != "odometry" or self.odometry is None:
            return super().motion(role)
        stamps_ns, poses = read_poses_tum(self.odometry)
        if len(self):
            if self.recorded is None:
                check_times(self.odometry, stamps_ns, self.numbers, self.stamps_ns)
            check_same_time(self.odometry, stamps_ns, self.stamps_ns)
        robots = poses @ self.body_from_robot
        return [
            Odometry(
                stamp_ns=int(stamps_ns[row]),
                frame_id="odom",
                child_frame_id="robot",
                pose=robots[row],
            )
            for row in np.argsort(stamps_ns, kind="stable")
        ]

    @property
    def counts(self) -> dict[str, int]:
        return {sensor: len(stream.files) for sensor, stream in self._all_streams.items()}

    @property
    def sensors(self) -> tuple[str, ...]:
        return tuple(self.streams)

    @property
    def _all_streams(self) -> Mapping[str, Stream]:
        return {**self.streams, **self.surround}

    def files(self) -> list[Path]:
        """The files of all frames, sensor by sensor."""
        return [
            stream.files[number]
            for stream in self._all_streams.values()
            for number in self.numbers.tolist()
            if number in stream.files
        ]

    def file_of(self, index: int) -> Path:
        return next(iter(self.streams.values())).files[int(self.numbers[index])]

    def content(self, sensor: str) -> str:
        """Number and format of the files, and the size of images or why the first has none."""
        path = next(iter(self._all_streams[sensor].files.values()))
        count = f"{counted(self.counts[sensor], 'file')} {path.suffix}"
        if sensor == "points":
            return count
        try:
            return "{}, {}x{}".format(count, *image_size(path))
        except DataError as error:
            return f"{count}; {one_line(error)}"

    def sensor_stamps(self, sensor: str) -> NDArray[np.int64] | None:
        """Stamps of a sensor of KITTI raw or KITTI-360, beside the folder of its files."""
        first = next(iter(self._all_streams[sensor].files.values()))
        path = first.parent.parent / "timestamps.txt"
        if self.kind not in ("kitti-raw", "kitti-360") or not path.exists():
            return None
        stamps = read_timestamps(path)
        return stamps[self.numbers[self.numbers < len(stamps)]]

    def _frame(self, index: int) -> Frame:
        number = int(self.numbers[index])
        cameras = self.frame_cameras(number) if self.frame_cameras else self.cameras
        scan: dict[str, Any] = {}  # functions that load it
        if self.has_points:
            path = self.streams["points"].files[number]
            # All from one file, which is read once.
            cloud = functools.cache(functools.partial(self.read_scan, path))
            scan = {"points": lambda: cloud().points, "intensities": lambda: cloud().intensities}
            # Only reading a .ply or .pcd tells whether it has colours; Frame passes None on.
            if path.suffix.lower() != ".bin":
                scan["colors"] = lambda: cloud().colors
        return Frame(
            index=index,
            number=number,
            stamp_ns=int(self.stamps_ns[index]),
            **scan,
            images={
                name: functools.partial(self._image, name, number, cameras.get(name))
                for name, stream in self._all_streams.items()
                if name != "points" and number in stream.files
            },
            cameras=cameras,
            pose=None if self.poses is None else self.poses[index],
            robot_from_points=self.robot_from_points,
        )

    def _image(self, name: str, number: int, camera: Camera | None) -> Image:
        path = self._all_streams[name].files[number]
        image = read_image(path)
        size = (image.shape[1], image.shape[0])
        if camera and camera.size:
            _same_size(path, size, camera.size, "the calibration")
        if name == "right" and self.has_stereo:
            left = self.streams["left"].files[number]
            _same_size(path, size, image_size(left), f"the left image {left}")
        return image


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class CloudDataset(Dataset):
    """Scans that are already coloured clouds in the robot's frame and need no fusion."""

    @abstractmethod
    def whole_cloud(self, index: int) -> Cloud:
        """The complete stored cloud of a scan, ground included."""

    def files(self) -> list[Path]:
        """The recording's single file."""
        return [self.root]

    def sensor_stamps(self, sensor: str) -> None:
        """None: scans have the stamps of their frames."""

    def _frame(self, index: int) -> Frame:
        cloud = functools.cache(functools.partial(self.whole_cloud, index))
        return Frame(
            index=index,
            number=int(self.numbers[index]),
            stamp_ns=int(self.stamps_ns[index]),
            points=(lambda: cloud().points) if self.has_points else None,
            colors=(lambda: cloud().colors) if self.has_points else None,
            pose=None if self.poses is None else self.poses[index],
            robot_from_points=self.body_from_points,
        )


def _same_size(path: Path, size: tuple[int, int], wanted: tuple[int, int], source: str) -> None:
    if size != tuple(wanted):
        raise DataError(
            f"image {path} is {size[0]}x{size[1]}, {source} says {wanted[0]}x{wanted[1]}",
            code="image-size",
            fields=(str(path),),
        )
