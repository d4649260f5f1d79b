# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""A bag as a ``Dataset``: its scans, each with its matching image or stereo pair."""

import functools
import logging
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from fusionslam.base.arrays import Matrix
from fusionslam.base.texts import counted
from fusionslam.datasets.bags import pairing
from fusionslam.datasets.bags.indexed_bag import IndexedBag
from fusionslam.datasets.bags.pairing import Matched, match, open_indexed_bag, with_poses
from fusionslam.datasets.bags.topics import INFO_ROLES, further_cameras, further_scanners, info_role
from fusionslam.datasets.base import Dataset, OdometryOrigin, PosesOrigin
from fusionslam.datasets.pose_files import match_poses
from fusionslam.datasets.streams import SENSORS, MissingSensorError, Request, itself
from fusionslam.errors import DataError, naming, one_line
from fusionslam.sensors.camera_info import camera_from, cameras_from, check_pair, rectify
from fusionslam.sensors.deskewing import motion_within, points_of
from fusionslam.sensors.frame import Camera, Frame
from fusionslam.sensors.image_series import ImageSeries
from fusionslam.sensors.messages import CameraInfo, Fix, Imu, Odometry, Picture, Scan
from fusionslam.sensors.scan_merging import Partner, merge_scans, time_remarks
from fusionslam.sensors.transforms import TransformError
from fusionslam.sensors.undone_motion import Deskew

logger = logging.getLogger(__name__)

_FUSED = {"points", "left"}
_STEREO = {"left", "right"}


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class BagDataset(Dataset):
    """Frames of a bag; scans and images are read one at a time, from any thread.

    Attributes:
        source: the open bag with its roles and index.
        matched: the messages of each frame.
        surround: index of each frame's image of further cameras, int64 (N); -1 where there is none.
        scanners: likewise of each frame's scan of further scanners, which is merged into its own.
        deskews: whether the motion within scans is undone.
    """

    source: IndexedBag
    matched: Matched
    surround: Mapping[str, NDArray[np.int64]] = field(default_factory=dict)
    scanners: Mapping[str, NDArray[np.int64]] = field(default_factory=dict)
    deskews: bool = True

    @property
    def short_name(self) -> str:
        """Name of the file, whichever topics are used."""
        return self.source.bag.path.name

    @property
    def counts(self) -> dict[str, int]:
        sensors = (*self.matched.rows, *self.surround, *self.scanners)
        return {sensor: len(self.source.series(sensor).stamps) for sensor in sensors}

    @property
    def sensors(self) -> tuple[str, ...]:
        return tuple(self.matched.rows)

    def files(self) -> list[Path]:
        """The files of the bag."""
        return sorted(self.root.iterdir()) if self.root.is_dir() else [self.root]

    def content(self, sensor: str) -> str:
        """Number and topic of the messages."""
        return f"{counted(self.counts[sensor], 'message')} of {self.source.roles[sensor]}"

    def sensor_stamps(self, sensor: str) -> NDArray[np.int64]:
        """Stamps of the sensor's messages in each frame, int64 (N)."""
        return _stamps(self.source, self.matched, sensor)

    def camera_images(self) -> ImageSeries | None:
        """All images of the left camera from the first frame to the last, by their stamps."""
        images = super().camera_images()
        if images is None or not len(images):
            return images
        series, topic = self.source.series("left"), self.source.roles["left"]
        rows = np.argsort(series.stamps_ns, kind="stable")
        seconds = series.stamps_ns[rows] / 1e9
        inside = (seconds >= images.seconds[0]) & (seconds <= images.seconds[-1])
        rows = rows[inside]

        def image(index: int) -> NDArray[np.uint8]:
            picture = self.source.bag.message(topic, *series.place(int(rows[index])))
            assert isinstance(picture, Picture)
            return picture.image

        return replace(images, seconds=seconds[inside], image=image, origin="images of the bag")

    def motion(self, role: str) -> list[Odometry]:
        found, by_arrival = [], self.source.stamps == "bag"
        topic = self.source.roles.get(role)
        if topic is None:
            return super().motion(role)
        # The index has counted and logged the messages that are left out.
        for raw in self.source.bag.raw([topic], on_error=lambda *_: None):
            with suppress(DataError):
                message = raw.value()
                assert isinstance(message, Odometry)
                stamp_ns = raw.time_ns if by_arrival else message.stamp_ns
                found.append(replace(message, stamp_ns=stamp_ns))
        if not found:
            raise DataError(
                f"{self.name}: none of the messages of {topic} can be used",
                code="no-messages",
                fields=(topic,),
            )
        return sorted(found, key=lambda message: message.stamp_ns)

    def imu_messages(self) -> Iterator[Imu]:
        return self.source.messages("imu", Imu)

    def fixes(self) -> Iterator[Fix]:
        return self.source.messages("fix", Fix)

    def robot_from_antenna(self) -> Matrix | None:
        first, robot = next(self.fixes(), None), self.source.frames.robot
        if first is None or robot is None:
            return None
        return self.source.find_transform(robot, first.frame_id, int(self.stamps_ns[0]))

    def points_from_imu(self) -> Matrix | None:
        first = next(self.imu_messages(), None)
        if first is None or not self.has_points:
            return None
        stamp_ns = int(self.stamps_ns[0])
        return self.source.find_transform(self.points_frame, first.frame_id, stamp_ns)

    @property
    def points_frame(self) -> str:
        return self.matched.points_frame

    def as_measured(self) -> Self:
        return replace(self, deskews=False)

    def of_leader(self) -> Self:
        return replace(self, scanners={})

    def _only(self, rows: NDArray[np.int64]) -> dict[str, Any]:
        further = {
            kind: {name: found[rows] for name, found in getattr(self, kind).items()}
            for kind in ("surround", "scanners")
        }
        return {"matched": self.matched.only(rows), **further}

    def _frame(self, index: int) -> Frame:
        scan: Callable[[], Scan] = functools.cache(functools.partial(self._scan, index))
        stamp_ns, robot = int(self.stamps_ns[index]), self.source.frames.robot
        motion = functools.cache(lambda: self._motion_within(scan(), stamp_ns))
        has_points, places = self.has_points, self.matched.cameras_from_points
        images = [sensor for sensor in self.sensors if sensor in INFO_ROLES]
        images += [name for name, rows in self.surround.items() if rows[index] >= 0]
        return Frame(
            index=index,
            number=int(self.numbers[index]),
            stamp_ns=stamp_ns,
            points=(lambda: points_of(scan(), motion())) if has_points else None,
            colors=(lambda: scan().colors) if has_points else None,
            intensities=(lambda: scan().intensities) if has_points else None,
            point_seconds=(lambda: None if motion() else scan().point_seconds)
            if has_points
            else None,
            deskew=motion if has_points else None,
            images={name: functools.partial(self._image, name, index) for name in images},
            cameras=_cameras(self.source, self.matched, index) | self._surround_cameras(index),
            pose=None if self.poses is None else self.poses[index],
            odometry=self.source.odometry_at(stamp_ns),
            robot_from_points=self.source.find_transform(robot, self.points_frame, stamp_ns)
            if robot and (has_points or places is not None)
            else None,
        )

    def _scan(self, index: int) -> Scan:
        leader: Scan = self._message("points", index)
        stamp_ns, partners = int(self.stamps_ns[index]), {}
        for name, rows in self.scanners.items():
            if rows[index] >= 0:
                offset_ns = int(self.source.series(name).stamps_ns[rows[index]]) - stamp_ns
                partners[name] = Partner(offset_ns, self._message(name, index))

        def leave_out(name: str, error: TransformError) -> None:
            words = f"{self.root}: scans of {self.source.roles[name]} are left out: {error}"
            self.source.say_once(f"place of {name}", words)

        scan = merge_scans(leader, partners, self.source.frames.tree, leave_out, stamp_ns)
        for name, remark in time_remarks(leader, partners, scan).items():
            self.source.say_once(f"times of {name}", f"{self.root}: {remark}")
        return scan

    def _motion_within(self, scan: Scan, stamp_ns: int) -> Deskew | None:
        """How the scanner moved within a scan; None where that is not known, or stays."""
        if not self.deskews:
            return None
        try:
            return motion_within(scan, self.source.frames, stamp_ns)
        except TransformError as error:
            if error.code in ("gap", "odometry-jump"):
                words = f"{self.root}: motion within scans stays where odometry fails: {error}"
                self.source.say_once(error.code, words)
            return None

    def _surround_cameras(self, index: int) -> dict[str, Camera]:
        """The further cameras with an image, a usable calibration and a known place."""
        cameras = {}
        for name, rows in self.surround.items():
            if rows[index] < 0:
                continue
            image_ns = int(self.source.series(name).stamps_ns[rows[index]])
            info = self.source.info_at(image_ns, name)
            with suppress(DataError):
                place = self.source.camera_from_points(
                    image_ns, self.matched.points_frame, int(self.stamps_ns[index]), name
                )
                if info is not None:
                    cameras[name] = camera_from(info, place, self.source.roles[info_role(name)])
        return cameras

    def _image(self, camera: str, index: int) -> NDArray[np.uint8]:
        picture: Picture = self._message(camera, index)
        stamps_ns = self.source.series(camera).stamps_ns
        info = self.source.info_at(int(stamps_ns[self._row_of(camera, index)]), camera)
        if info is None:
            return picture.image
        with naming(self.root):
            return rectify(picture, info, self.source.roles[camera])

    def _message(self, sensor: str, index: int) -> Any:
        place = self.source.series(sensor).place(self._row_of(sensor, index))
        return self.source.bag.message(self.source.roles[sensor], *place)

    def _row_of(self, sensor: str, index: int) -> int:
        return int({**self.matched.rows, **self.surround, **self.scanners}[sensor][index])


def open_bag_dataset(path: Path, request: Request) -> BagDataset:
    """Open a bag; its frames are the scans that have an image and a known camera pose.

    Raises:
        DataError: the bag has no scans or images; the clock jumps back; or of sensors that were
            requested a CameraInfo is missing or unusable, two are not a stereo pair, or TF does not
            link camera and scanner.
        ConfigError: an unknown role or kind of stamps.
    """
    itself(path, request.sequence)
    source = open_indexed_bag(path, request.topics, request.stamps, calibration=request.calibration)
    return dataset_of(source, request)


def dataset_of(source: IndexedBag, request: Request) -> BagDataset:
    """Make the dataset of an open bag. Raises as ``open_bag_dataset``."""
    path, sensors = source.bag.path, _sensors(source, request.sensors)
    matched = match(source, sensors, request.sync)
    moved = pairing.motion(source, _stamps(source, matched, sensors[0]))
    poses, origin = moved.poses, moved.origin
    if request.poses is None:
        matched = with_poses(source, matched, moved)
    stamps_ns = _stamps(source, matched, sensors[0])
    recorded = len(source.series(sensors[0]).stamps)
    if request.poses is not None:
        poses = match_poses(request.poses, matched.numbers, stamps_ns, recorded=recorded)
        origin = PosesOrigin.FILE
    odometry_origin = OdometryOrigin.NONE
    if "odometry" in source.roles:
        odometry_origin = OdometryOrigin.TOPIC
    elif source.frames.odometry is not None:
        odometry_origin = OdometryOrigin.TF
    has_points = moved.body and ("points" in sensors or matched.cameras_from_points is not None)
    dataset = BagDataset(
        kind=source.bag.kind,
        name=_name(source),
        root=path,
        numbers=matched.numbers,
        stamps_ns=stamps_ns,
        pose_frame=moved.body or "the robot",
        origin=origin,
        truth_topic=source.roles.get("truth"),
        odometry_topic=source.roles.get("odometry"),
        odometry_origin=odometry_origin,
        body_from_points=source.find_transform(moved.body, matched.points_frame, int(stamps_ns[0]))
        if has_points
        else None,
        poses=poses,
        cameras=_cameras(source, matched, 0),
        gaps=matched.gaps,
        recorded=recorded,
        source=source,
        matched=matched,
        surround=pairing.match_surround(source, matched, request.sync),
        scanners=pairing.match_scanners(source, matched, request.sync),
        deskews=request.deskew,
    )
    return replace(dataset, cameras=dataset[0].cameras) if dataset.surround else dataset


def _sensors(source: IndexedBag, wanted: Sequence[str] | None) -> tuple[str, ...]:
    """Choose the sensors of the frames: those requested, else those that the bag has.

    An image alone needs no calibration; an image with a scan, or a stereo pair, does. A right
    camera that was not requested and cannot be used is left out, and the reason is logged.
    """
    roles, path = source.roles, source.bag.path
    if wanted is None:
        found = tuple(sensor for sensor in SENSORS if sensor in roles and sensor != "right")
        if not found:
            message = f"{path} has neither PointCloud2 nor Image messages: {_topics(source)}"
            raise DataError(message, code="no-frames")
        return _usable(source, found)
    for sensor in wanted:
        if sensor not in roles:
            raise MissingSensorError(
                f"{path} has no messages for '{sensor}' with which to make frames: "
                f"{_topics(source)}",
                fields=(sensor,),
            )
    if "right" in wanted and "left" not in wanted:
        message = f"{path}: 'right' images are read as part of a stereo pair, with 'left'"
        raise DataError(message, code="no-pair")
    if {*wanted} >= _FUSED:
        _check_calibrated(source, "left")
    if "right" in wanted:
        _check_stereo(source)
    return tuple(sensor for sensor in SENSORS if sensor in wanted)


def _usable(source: IndexedBag, found: tuple[str, ...]) -> tuple[str, ...]:
    """Choose those of scans and left images that can be used, and right images if possible."""
    lacking = ""
    if {*found} >= _FUSED and source.info_at(0) is None:
        lacking = "no CameraInfo calibrates them: topics= (--topic camera_info=/NAME) names a topic"
    elif {*found} >= _FUSED and "right" not in source.roles:  # a stereo pair needs no TF
        try:
            source.frames.tree.chain(source.optical_frame(), source.series("points").frame_id)
        except TransformError as error:
            lacking = f"TF does not place the camera: {one_line(error)}"
    if lacking:
        logger.warning(
            "%s: the images of %s are not used, %s; calibration= (--calib FILE) takes a calib.yaml",
            source.bag.path,
            source.roles["left"],
            lacking,
        )
        return found[:1]
    if not source.roles.keys() >= _STEREO:
        return found
    try:
        _check_stereo(source)
    except DataError as error:
        logger.warning("right images are not used: %s", error)
        return found
    return (*found, "right")


def _check_stereo(source: IndexedBag) -> None:
    """Raise DataError unless both cameras are calibrated and form a stereo pair."""
    infos, names = {}, {}
    for camera in ("left", "right"):
        infos[camera] = _check_calibrated(source, camera)
        names[camera] = source.roles[INFO_ROLES[camera]]
    with naming(source.bag.path):
        check_pair(infos["left"], infos["right"], names)


def _check_calibrated(source: IndexedBag, camera: str) -> CameraInfo:
    """Return a camera's first calibration. Raises DataError if there is none."""
    info, topic = source.info_at(0, camera), source.roles[camera]
    if info is None:
        message = f"{source.bag.path} has no CameraInfo of {topic}: {_topics(source)}"
        raise DataError(message, code="no-camera-info", fields=(topic,))
    return info


def _topics(source: IndexedBag) -> str:
    topics = [f"{topic.name} ({topic.type})" for topic in source.bag.topics.values()]
    return f"its topics are {', '.join(topics)}" if topics else "it has no topics"


def _stamps(source: IndexedBag, matched: Matched, sensor: str) -> NDArray[np.int64]:
    return source.series(sensor).stamps_ns[matched.rows[sensor]]


def _cameras(source: IndexedBag, matched: Matched, index: int) -> dict[str, Camera]:
    if matched.cameras_from_points is None:
        return {}
    infos, names = {}, {}
    for camera, role in INFO_ROLES.items():
        if camera in matched.rows:
            info = source.info_at(int(_stamps(source, matched, camera)[index]), camera)
            assert info is not None  # ensured by _sensors
            infos[camera], names[camera] = info, source.roles[role]
    with naming(source.bag.path):
        return cameras_from(infos, matched.cameras_from_points[index], names)


def _name(source: IndexedBag) -> str:
    """Name of the bag with its topics in use, so that results from other topics differ in name."""
    further = (*further_cameras(source.roles), *further_scanners(source.roles))
    roles = (*SENSORS, *further, "odometry", "truth")
    used = [source.roles[role] for role in roles if role in source.roles]
    clock = ", times of arrival" if source.stamps == "bag" else ""
    return f"{source.bag.path.name} ({', '.join(used)}{clock})"
