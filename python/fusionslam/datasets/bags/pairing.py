# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Pairs the scans of a bag with images and finds the camera poses and the robot's motion."""

import functools
import logging
from collections.abc import Callable, Collection, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fusionslam.base.arrays import Matrix
from fusionslam.datasets.bags.calibration import apply_calibration
from fusionslam.datasets.bags.indexed_bag import STAMPS, IndexedBag, index_bag, lookup_or_none
from fusionslam.datasets.bags.reader import open_bag
from fusionslam.datasets.bags.topics import (
    READ_LATE,
    choose_topics,
    further_cameras,
    further_scanners,
)
from fusionslam.datasets.base import PosesOrigin
from fusionslam.errors import ConfigError, DataError
from fusionslam.sensors.messages import NANOSECONDS, as_nanoseconds
from fusionslam.sensors.synchronizer import (
    Pair,
    SyncConfig,
    Synchronizer,
    choose_image,
    partner_config,
    stereo_synchronizer,
)
from fusionslam.sensors.transforms import TransformError

logger = logging.getLogger(__name__)

Rows = NDArray[np.int64]

NO_PAIRS = "no-pairs"
"""Code of the error for sensors none of whose messages lie near in time."""


def open_indexed_bag(
    path: Path,
    named: Mapping[str, str],
    stamps: str,
    *,
    calibration: Path | None = None,
    everything: bool = False,
) -> IndexedBag:
    """Open and index a bag; the result is reused until its files change.

    Args:
        path: file or folder.
        named: topics by role, as ``choose_topics`` takes them.
        stamps: "header" or "bag".
        calibration: calib.yaml to use instead of CameraInfo and of the camera's pose in TF.
        everything: index all topics, not only those in use.

    Raises:
        DataError: the bag or the calibration cannot be read, or a topic does not exist.
        ConfigError: an unknown role or kind of stamps.
    """
    if stamps not in STAMPS:
        raise ConfigError(f"stamps is '{stamps}', expected one of {', '.join(STAMPS)}")
    files = sorted(path.iterdir()) if path.is_dir() else [path]
    files += [calibration] if calibration is not None and calibration.exists() else []
    state = tuple((str(file), file.stat().st_mtime_ns, file.stat().st_size) for file in files)
    return _open_cached(path, tuple(sorted(named.items())), stamps, calibration, everything, state)


# Commands open a recording once per source of clouds.
@functools.lru_cache(maxsize=2)
def _open_cached(
    path: Path,
    named: tuple[tuple[str, str], ...],
    stamps: str,
    calibration: Path | None,
    everything: bool,
    state: object,
) -> IndexedBag:
    bag = open_bag(path)
    roles = choose_topics(bag.topics, dict(named), str(path))
    known = [topic.name for topic in bag.topics.values() if topic.is_known]
    used = [topic for role, topic in roles.items() if role not in READ_LATE]
    source = index_bag(bag, known if everything else used, roles, stamps)
    if calibration is not None:
        apply_calibration(source, calibration)
    return source


class Matched(NamedTuple):
    """The frames of a bag.

    Attributes:
        rows: by sensor, index of each frame's message, int64 (N).
        numbers: int64 (N), rank of each frame's scan (or left image, without scans) among all.
        gaps: numbers that are not part of a frame.
        points_frame: frame of the scans, or of the points from stereo pairs.
        cameras_from_points: float64 (N, 4, 4), of the left camera; None for scans or single
            images alone.
    """

    rows: dict[str, Rows]
    numbers: Rows
    gaps: list[int]
    points_frame: str
    cameras_from_points: Matrix | None

    def only(self, kept: NDArray[np.int64] | NDArray[np.bool_]) -> "Matched":
        """Only some of the frames, by their indices or as a mask."""
        places = self.cameras_from_points
        return self._replace(
            rows={name: rows[kept] for name, rows in self.rows.items()},
            numbers=self.numbers[kept],
            cameras_from_points=None if places is None else places[kept],
        )


def match(source: IndexedBag, sensors: tuple[str, ...], config: SyncConfig) -> Matched:
    """Match each scan with its images; scans without images or camera pose are left out.

    Without scans, each left image is a frame, with its right one if that is among the sensors.

    Raises:
        DataError: no scan has an image, or none a known camera pose; or the clock jumps back.
    """
    for role in (*sensors, *(role for role in ("odometry", "truth") if role in source.roles)):
        _check_clock(source, role, config)
    rows = _pair_messages(source, sensors, config)
    places, points_frame = None, source.points_frame(sensors)
    if "left" in sensors and len(sensors) > 1:
        places, rows = _find_camera_poses(source, rows, sensors[0], points_frame)
    ranks = np.argsort(np.argsort(source.series(sensors[0]).stamps_ns, kind="stable"))
    numbers = ranks[rows[sensors[0]]].astype(np.int64)
    gaps = np.setdiff1d(ranks, numbers).tolist()
    return Matched(rows, numbers, gaps, points_frame, places)


def match_surround(source: IndexedBag, matched: Matched, config: SyncConfig) -> dict[str, Rows]:
    """Index of the image of each further camera for each frame, int64 (N); -1 where none is near.

    Only scans have further cameras.

    Raises:
        DataError: the clock of a camera jumps back.
    """
    if not {"points", "left"} <= matched.rows.keys():
        return {}
    cameras = further_cameras(source.roles)
    return {name: _nearest(source, matched, name, config) for name in cameras}


def match_scanners(source: IndexedBag, matched: Matched, config: SyncConfig) -> dict[str, Rows]:
    """Index of the scan of each further scanner for each frame, int64 (N); -1 where none is near.

    Raises:
        DataError: the clock of a scanner jumps back, none of its scans is near one of the leading
            scanner's, or TF does not link the two.
    """
    if "points" not in matched.rows:
        return {}
    found = {}
    for name in further_scanners(source.roles):
        topic, leader = source.roles[name], source.roles["points"]
        rows = found[name] = _nearest(source, matched, name, partner_config(config))
        if (rows < 0).all():
            apart_s = source.series(name).stamps_ns[0] - source.series("points").stamps_ns[0]
            raise DataError(
                f"{source.bag.path}: no scan of {topic} lies within {config.scan_difference:g} s "
                f"of one of {leader}: their first stamps are {apart_s / NANOSECONDS:+.3f} s apart. "
                "Expected one clock; stamps='bag' takes the times of arrival",
                code=NO_PAIRS,
                fields=(leader, topic),
            )
        ends = matched.points_frame, source.series(name).frame_id
        try:
            source.frames.tree.chain(*ends)
        except TransformError as error:
            if ends[0] == ends[1]:
                continue
            raise DataError(
                f"{source.bag.path}: TF does not place the scanner of {topic}: {error}",
                code=error.code,
                fields=error.fields,
            ) from error
    return found


def _nearest(source: IndexedBag, matched: Matched, role: str, config: SyncConfig) -> Rows:
    """Index of the message of a further sensor for each scan; -1, which is said, without one."""
    _check_clock(source, role, config)
    scans = source.series("points").stamps_ns[matched.rows["points"]].tolist()
    reach_ns = as_nanoseconds("max_difference", config.max_difference)
    stamps = source.series(role).stamps_ns
    order = np.argsort(stamps, kind="stable")
    rising = stamps[order].tolist()
    places = [choose_image(rising, scan, config.policy, reach_ns) for scan in scans]
    rows = [-1 if place is None else order[place] for place in places]
    if missing := rows.count(-1):
        logger.warning(
            "%s: %d of %d scans have no message of %s near",
            source.bag.path,
            missing,
            len(scans),
            source.roles[role],
        )
    return np.array(rows, dtype=np.int64)


def _check_clock(source: IndexedBag, role: str, config: SyncConfig) -> None:
    """Raise DataError if the stamps of a topic are all equal or jump back."""
    stamps, topic = source.series(role).stamps_ns, source.roles[role]
    advice = "stamps='bag' takes the times of arrival"
    if len(stamps) > 1 and stamps.min() == stamps.max():
        raise DataError(
            f"{source.bag.path}: all {len(stamps)} messages of {topic} have the stamp "
            f"{stamps[0]} ns, expected rising ones; {advice}",
            code="equal-stamps",
            fields=(topic,),
        )
    back = np.maximum.accumulate(stamps) - stamps
    if len(jumps := np.flatnonzero(back > config.jump * NANOSECONDS)):
        row = int(jumps[0])
        raise DataError(
            f"{source.bag.path}: the clock of {topic} jumps back by {back[row] / 1e9:.3f} s at "
            f"message {row} of {len(stamps)}, expected rising stamps; {advice}",
            code="clock",
            fields=(topic, str(row)),
        )


def _pair_messages(
    source: IndexedBag, sensors: tuple[str, ...], config: SyncConfig
) -> dict[str, Rows]:
    """Group messages by ascending stamp: first left and right images, then scans with images."""
    if "right" not in sensors:
        sync = Synchronizer(config, cameras=sensors[1:], scans=sensors[0])
        return _rows(source, sensors, sync, config.max_difference)
    sides = stereo_synchronizer(config)
    rows = _rows(source, ("left", "right"), sides, config.stereo_difference)
    if "points" not in sensors:
        return rows
    right = dict(zip(rows["left"].tolist(), rows["right"].tolist(), strict=True))
    sync = Synchronizer(config)
    rows = _rows(source, ("points", "left"), sync, config.max_difference, right)
    return rows | {"right": np.array([right[row] for row in rows["left"].tolist()], dtype=np.int64)}


def _rows(
    source: IndexedBag,
    sensors: tuple[str, ...],
    sync: Synchronizer,
    reach: float,
    left: Collection[int] | None = None,
) -> dict[str, Rows]:
    """Indices of the messages that belong together; ``left`` restricts the left images."""
    first, *others = sensors
    pairs: list[Pair] = []
    arrivals = [
        (time_ns, rank, row, stamp_ns)
        for rank, sensor in enumerate(sensors)
        for row, (time_ns, stamp_ns) in enumerate(
            zip(source.series(sensor).times, source.series(sensor).stamps, strict=True)
        )
    ]
    for _, rank, row, stamp_ns in sorted(arrivals):
        if sensors[rank] != "left" or left is None or row in left:
            pairs += sync.add(sensors[rank], stamp_ns, row)
    pairs += sync.flush()
    for (sensor, reason), count in sync.dropped.items():
        words = source.bag.path, count, source.roles[sensor], reason
        logger.warning("%s: %d messages of %s left out: %s", *words)
    if not pairs:
        what = " and ".join(source.roles[sensor] for sensor in sensors)
        raise DataError(
            f"{source.bag.path}: no messages of {what} lie within {reach:g} s of "
            "each other; the clock offsets are in the output of info",
            code=NO_PAIRS,
            fields=tuple(source.roles[sensor] for sensor in sensors),
        )
    rows = {first: [pair.item for pair in pairs]}
    rows |= {name: [pair.images[name].item for pair in pairs] for name in others}
    return {name: np.array(values, dtype=np.int64) for name, values in rows.items()}


def _find_camera_poses(
    source: IndexedBag, rows: dict[str, Rows], lead: str, points_frame: str
) -> tuple[Matrix, dict[str, Rows]]:
    """Pose of the left camera for each frame, and the frames for which it is known."""
    images, leads = (source.series(name).stamps_ns[rows[name]] for name in ("left", lead))
    places: dict[int, Matrix] = {}
    unknown: list[TransformError] = []
    for k, (image_ns, scan_ns) in enumerate(zip(images.tolist(), leads.tolist(), strict=True)):
        try:
            places[k] = source.camera_from_points(image_ns, points_frame, scan_ns)
        except TransformError as error:
            unknown.append(error)
    if not places:
        raise DataError(
            f"{source.bag.path}: TF does not place the camera: {unknown[0]}",
            code="no-camera-pose",
            fields=unknown[0].fields,
        ) from unknown[0]
    if unknown:
        logger.warning(
            "%s: %d %s left out: %s",
            source.bag.path,
            len(unknown),
            "scans" if lead == "points" else "stereo pairs",
            unknown[0],
        )
    kept = np.array(list(places), dtype=np.int64)
    return np.stack(list(places.values())), {name: values[kept] for name, values in rows.items()}


class Motion(NamedTuple):
    """Motion of a robot.

    Attributes:
        body: the frame that moved.
        poses: float64 (K, 4, 4), or None if unknown.
        known: bool (N), the times that have a pose: K of them.
        origin: origin of the poses.
    """

    body: str
    poses: Matrix | None
    known: NDArray[np.bool_]
    origin: PosesOrigin


def motion(source: IndexedBag, stamps_ns: NDArray[np.int64]) -> Motion:
    """Motion by ground truth or odometry (messages, else TF), whichever knows more poses.

    Bags often begin before their odometry: ``known`` marks the times that have a pose.
    """
    found, frames = [], source.frames
    if source.truth_frames is not None:
        world, body = source.truth_frames
        truth, origin = source.truth, PosesOrigin.TRUTH
        found.append(
            _motion(body, origin, stamps_ns, lambda stamp: truth.lookup(world, body, stamp))
        )
    robot = frames.robot or ""
    if frames.odometry is not None:
        # Who names one topic for both says that its odometry is the truth.
        same = source.roles.get("truth") == source.roles.get("odometry", "")
        origin = PosesOrigin.TRUTH if same else PosesOrigin.ODOMETRY
        found.append(_motion(robot, origin, stamps_ns, frames.odometry_from_robot))
    found.append(Motion(robot, None, np.ones(len(stamps_ns), dtype=bool), PosesOrigin.NONE))
    # On ties the first: ground truth.
    return max(found, key=lambda moved: 0 if moved.poses is None else len(moved.poses))


def _motion(
    body: str,
    origin: PosesOrigin,
    stamps_ns: NDArray[np.int64],
    lookup: Callable[[int], Matrix | None],
) -> Motion:
    poses = [lookup_or_none(functools.partial(lookup, stamp_ns)) for stamp_ns in stamps_ns.tolist()]
    known = np.array([pose is not None for pose in poses])
    found = [pose for pose in poses if pose is not None]
    return Motion(body, np.stack(found) if found else None, known, origin)


def with_poses(source: IndexedBag, matched: Matched, moved: Motion) -> Matched:
    """Keep the frames whose pose is known; the number of others is logged."""
    if moved.poses is None or moved.known.all():
        return matched
    lost = matched.numbers[~moved.known]
    logger.warning(
        "%s: %d of %d frames left out, which have no pose by %s: numbers %d to %d",
        source.bag.path,
        len(lost),
        len(matched.numbers),
        "the truth" if moved.origin is PosesOrigin.TRUTH else "odometry",
        lost[0],
        lost[-1],
    )
    return matched.only(moved.known)._replace(gaps=sorted([*matched.gaps, *lost.tolist()]))
