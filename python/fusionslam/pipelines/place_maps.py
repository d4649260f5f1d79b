# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Maps of recordings: building, localising and exporting."""

import csv
import logging
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from itertools import chain, count
from pathlib import Path
from typing import Literal, NamedTuple, TypeVar

import numpy as np
from scipy.spatial.transform import Rotation

from fusionslam.base.arrays import Floats, Matrix
from fusionslam.base.files import PathLike, atomic_path
from fusionslam.base.parallel import ordered_results
from fusionslam.base.progress import Progress, Step, label_progress
from fusionslam.calibration.mistakes import warn_of_wrong_calibration
from fusionslam.datasets import Dataset
from fusionslam.datasets.cloud_files import write_cloud
from fusionslam.datasets.pose_files import (
    interpolate_poses,
    write_poses_kitti,
    write_poses_tum,
)
from fusionslam.errors import DataError
from fusionslam.fusion import OPTICAL, looks_along_z
from fusionslam.geometry.globe import MapOrigin, utm_code, utm_poses
from fusionslam.geometry.odometry_noise import OdometryConfig, add_odometry_errors
from fusionslam.geometry.se2 import places_of
from fusionslam.geometry.trajectory import ground_poses
from fusionslam.mapping import Localization, PlaceMap
from fusionslam.mapping.clouds import unpack_cloud
from fusionslam.mapping.fixes import add_fixes
from fusionslam.mapping.frame_poses import FramePoses, frame_poses
from fusionslam.mapping.geojson import write_geojson
from fusionslam.mapping.graph_export import write_map_graph
from fusionslam.odometry import LidarOdometryConfig
from fusionslam.odometry.tracking import scan_odometry
from fusionslam.pipelines.lidar_odometry import track_lidar
from fusionslam.pipelines.odometry_check import warn_of_wrong_odometry
from fusionslam.pipelines.recording import name_frame
from fusionslam.registration import Refusal
from fusionslam.sensors.frame import Frame

logger = logging.getLogger(__name__)

T = TypeVar("T")

MapOdometry = Literal["recorded", "lidar", "inertial", "truth+noise"]
_MOST_COMPARED = 50
"""Keyframes of a map in which it is looked which way is up."""
POSE_NAMES = ("x", "y", "z", "qx", "qy", "qz", "qw")

_MAP_CODES = ("cannot-read", "cannot-write", "changed", "closed", "damaged", "locked")
"""Codes of errors of a map's file."""


class Built(NamedTuple):
    """What building a map made of a recording.

    Attributes:
        frames: number of frames that were added or looked at; 0 if the map had all of them.
        keyframes, loops: numbers of new ones.
        skipped: reasons by number of the frames that could not be used.
    """

    frames: int
    keyframes: int
    loops: int
    skipped: dict[int, str]


def has_odometry(dataset: Dataset) -> bool:
    """Whether odometry was recorded with the frames."""
    return dataset.odometry_topic is not None or dataset[0].odometry is not None


def check_odometry(dataset: Dataset, kind: MapOdometry) -> None:
    """Raise DataError unless a recording has what odometry of a kind is made of.

    Its code is "no-odometry" or "no-poses".
    """
    if kind == "recorded" and not has_odometry(dataset):
        raise DataError(
            f"{dataset.name} has no odometry, which a map needs: --odometry lidar takes it "
            "from the scans, --odometry truth+noise from true poses",
            code="no-odometry",
            fields=(dataset.name,),
        )
    if kind == "truth+noise" and dataset.true_poses is None:
        raise DataError(
            f"{dataset.name} has no true poses for --odometry truth+noise: --gt FILE names them",
            code="no-poses",
            fields=(dataset.name,),
        )


def odometry_of(
    dataset: Dataset,
    kind: MapOdometry,
    *,
    scanned: LidarOdometryConfig | None = None,
    errors: OdometryConfig | None = None,
    jobs: int = 1,
    step: Step | None = None,
) -> Floats | None:
    """Return odometry for a map, float64 (N, 4, 4), odom_from_robot; None for the recorded one.

    Args:
        dataset: the recording.
        kind: "recorded"; "lidar", from the scans; "inertial", from scans and an IMU;
            "truth+noise", true poses with errors.
        scanned: configuration of odometry by LiDAR.
        errors: of "truth+noise".
        jobs: number of scans read ahead.
        step: progress callback.

    Raises:
        DataError: the data lack what is asked for.
    """
    check_odometry(dataset, kind)
    if kind == "recorded":
        at_frames = dataset[0].odometry is not None
        return None if at_frames else _odometry_at_frames(dataset)
    if kind in ("lidar", "inertial"):
        show = label_progress(step, "registering scans")
        chosen = scan_odometry(kind, scanned)
        track = track_lidar(dataset, chosen, jobs=jobs, progress=show)
        return track.poses @ dataset.body_from_robot
    assert dataset.true_poses is not None  # checked above
    places = places_of(dataset.true_poses @ dataset.body_from_robot)
    seconds = (dataset.stamps_ns - dataset.stamps_ns[0]) / 1e9
    return ground_poses(*add_odometry_errors(places, seconds, errors or OdometryConfig()).T)


def _odometry_at_frames(dataset: Dataset) -> Floats:
    """Odometry of a file, at the stamps of the frames; NaN before and after it."""
    moved = dataset.motion("odometry")
    stamps = np.array([each.stamp_ns for each in moved], np.int64)
    if len(stamps) < 2:
        raise DataError(
            f"{dataset.name}: {len(stamps)} pose of odometry, expected two or more",
            code="no-odometry",
            fields=(dataset.name,),
        )
    poses = np.array([each.pose for each in moved])
    at_frames, gaps_ns = interpolate_poses(stamps, poses, dataset.stamps_ns)
    at_frames[np.isinf(gaps_ns)] = np.nan
    return at_frames


def build_map(
    site: PlaceMap,
    dataset: Dataset,
    odometry: Floats | None = None,
    *,
    bad_frames: str = "error",
    jobs: int = 1,
    progress: Progress | None = None,
) -> Built:
    """Add a recording to a map, beginning after the session's last keyframe.

    Args:
        site: open with a session.
        dataset: the recording.
        odometry: as ``odometry_of`` returns.
        bad_frames: "skip" leaves out frames that cannot be used.
        jobs: number of frames read ahead.
        progress: called with (frames done, total).

    Raises:
        DataError: a frame cannot be used, or the map cannot be written; what was added stays.
    """
    last = site.last_frame
    begin = 0 if last is None else int(np.searchsorted(dataset.numbers, last, side="right"))
    keyframes = loops = 0
    skipped: dict[int, str] = {}
    if last is None:
        warn_of_wrong_odometry(dataset, odometry)
        warn_of_wrong_calibration(dataset, site.settings.fusion.source)
    walk = _use_frames(dataset, site.add, begin, odometry, bad_frames, jobs, progress)
    for index, added in walk:
        if isinstance(added, DataError):
            skipped[int(dataset.numbers[index])] = str(added)
        else:
            keyframes += added.keyframe is not None
            loops += len(added.loops)
    if not _add_fixes(site, dataset) and keyframes:
        site.solve()
    return Built(len(dataset) - begin, keyframes, loops, skipped)


def _add_fixes(site: PlaceMap, dataset: Dataset) -> bool:
    """Put the map where a recording's satellite receiver has it; False if nothing is new."""
    fixes = [*dataset.fixes()]
    if not fixes or site.session not in site.content.sessions:
        return False
    assert site.session is not None
    mount = dataset.robot_from_antenna()
    if mount is None:
        logger.warning(
            "%s: TF does not link the antenna (%r) to the robot: it is taken to be at its origin",
            *(dataset.name, fixes[0].frame_id),
        )
        mount = np.eye(4)
    try:
        is_new = add_fixes(site, site.session, fixes, mount)
    except DataError as error:
        if error.code not in ("no-fixes", "other-clock"):
            raise
        logger.warning("%s: fixes are left out: %s", dataset.name, error)
        return False
    for part, place in site.content.places.items():
        if isinstance(place, Refusal):
            text = "%s: part %d of the map is not on the globe: %s"
            logger.warning(text, dataset.name, part, place)
    return is_new


def true_keyframes(site: PlaceMap, session: str, dataset: Dataset) -> Floats | None:
    """Return true poses of the robot at a session's keyframes, float64 (n, 4, 4).

    NaN where they are unknown; None if the recording has none.

    Args:
        site: the map.
        session: name of the session.
        dataset: its recording.
    """
    if dataset.true_poses is None:
        return None
    poses, frames = dataset.true_poses @ dataset.body_from_robot, site.frames(session)
    rows = np.searchsorted(dataset.numbers, frames).clip(max=len(dataset) - 1)
    known = dataset.numbers[rows] == frames
    return np.where(known[:, None, None], poses[rows], np.nan)


def localize_recording(
    site: PlaceMap,
    dataset: Dataset,
    odometry: Floats | None = None,
    *,
    bad_frames: str = "error",
    jobs: int = 1,
    progress: Progress | None = None,
) -> Iterator[tuple[int, int, Localization]]:
    """Find each frame of a recording on a map: its number, stamp in nanoseconds, and place.

    Arguments as of ``build_map``; frames may have no odometry. "skip" says of frames that cannot
    be used why they have no place.

    Raises:
        DataError: a frame cannot be used, or the map is damaged (code "damaged").
    """
    walk = _use_frames(dataset, site.localize, 0, odometry, bad_frames, jobs, progress)
    for index, found in walk:
        if isinstance(found, DataError):
            found = Localization(None, reason=Refusal(found.code, 0, str(found)))
        yield int(dataset.numbers[index]), int(dataset.stamps_ns[index]), found


def _use_frames(
    dataset: Dataset,
    use: Callable[..., T],
    begin: int,
    odometry: Floats | None,
    bad_frames: str,
    jobs: int,
    progress: Progress | None,
) -> Iterator[tuple[int, T | DataError]]:
    """Yield what is made of each frame, by its row; with "skip", or why it cannot be used."""

    def read(index: int) -> Frame | DataError:
        try:
            frame = dataset[index]
            _ = frame.points, frame.colors, [frame.images[name] for name in frame.images]
        except DataError as error:
            return error
        return frame

    made: T | DataError
    with ordered_results(read, range(begin, len(dataset)), jobs) as frames:
        for index, frame in enumerate(frames, start=begin):
            try:
                with name_frame(dataset, index, can_skip=True):
                    if isinstance(frame, DataError):
                        raise frame
                    made = use(frame, odometry=None if odometry is None else odometry[index])
            except DataError as error:
                if error.code in _MAP_CODES and isinstance(error.__cause__, DataError):
                    raise error.__cause__ from None  # the frame is not to blame for the map's error
                if bad_frames != "skip":
                    raise
                made = error
            yield index, made
            if progress is not None:
                progress(index + 1, len(dataset))


class Localized(NamedTuple):
    """How many frames of a recording were found on a map, and why others were not.

    Attributes:
        frames: number of frames that were looked at.
        found: number of those with a pose.
        reasons: numbers of the others by the code of the reason, the most frequent first.
    """

    frames: int
    found: int
    reasons: dict[str, int]

    @classmethod
    def of(cls, found: Sequence[tuple[int, int, Localization]]) -> "Localized":
        """Count what ``localize_recording`` yields."""
        codes = [each.reason.code for *_, each in found if each.reason is not None]
        return cls(len(found), len(found) - len(codes), dict(Counter(codes).most_common()))

    def __str__(self) -> str:
        """Say it in a line."""
        reasons = (f"; {count} not: {code}" for code, count in self.reasons.items())
        return f"{self.found} of {self.frames} frames found{''.join(reasons)}"


def write_localizations(path: PathLike, found: Sequence[tuple[int, int, Localization]]) -> None:
    """Write a CSV: frame, stamp_ns, map_from_robot (x, y, z, qx, qy, qz, qw), keyframe,
    part, reason.

    Raises:
        DataError: the file cannot be written.
    """
    with atomic_path(path) as temporary, temporary.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["frame", "stamp_ns", *POSE_NAMES, "keyframe", "part", "reason"])
        for number, stamp_ns, each in found:
            reason = "" if each.reason is None else each.reason.code
            pose = [""] * len(POSE_NAMES) if each.pose is None else pose_texts(each.pose)
            writer.writerow([number, stamp_ns, *pose, each.keyframe, each.part, reason])


class Track(NamedTuple):
    """Poses of all frames of a session in one part of a map.

    Attributes:
        session, part: of them.
        frames: the poses.
    """

    session: str
    part: int
    frames: FramePoses


def export_map(
    site: PlaceMap,
    folder: PathLike,
    *,
    voxel: float = 0.1,
    resolution: float = 0.05,
    origin: MapOrigin | None = None,
    frame: Literal["map", "utm"] = "map",
    covariance: bool = False,
) -> dict[Path, Track | None]:
    """Write a map for other programs; returns the files, and what poses they have.

    ``cloud.ply``, ``cloud.pcd``; ``grid.pgm`` and ``grid.yaml`` for map_server; ``heights.asc``;
    ``graph.g2o``; ``SESSION.tum`` and ``SESSION.kitti``, poses of all frames (``name_tracks``);
    of parts whose origin is known ``trajectory.geojson``. Cloud, grid, heights and graph are those
    of the map's first part.

    Args:
        site: the map.
        folder: made if missing.
        voxel: of the clouds, metres.
        resolution: of the grid, metres.
        origin: where on the globe the first part of the map is; by default as its fixes say.
        frame: of the poses; "utm": of the zone that the map is in, whose code of EPSG the names of
            their files have. Parts whose origin is unknown are left out then, with a warning.
        covariance: whether poses are written with their covariances, too (``SESSION.csv``).

    Raises:
        DataError: the map has no keyframes (code "empty"), nothing tells where it is for UTM
            ("no-origin"), or a file cannot be written.
    """
    if not len(site):
        raise DataError("the map has no keyframes: there is nothing to export", code="empty")
    origins = dict(site.content.origins)
    if origin is not None:
        origins[site.content.parts[0]] = origin
    if frame == "utm" and not origins:
        raise DataError(
            f"{site.path} is not on the globe: expected --origin, or fixes of a satellite receiver",
            code="no-origin",
            fields=(str(site.path),),
        )
    target = Path(folder)
    _warn_of_optical(site)
    cloud = site.cloud(voxel)
    clouds = [target / "cloud.ply", target / "cloud.pcd"]
    for path in clouds:
        write_cloud(path, cloud)
    grid = site.grid(resolution).save(target / "grid.pgm")
    heights, graph = target / "heights.asc", target / "graph.g2o"
    site.heights().save(heights)
    write_map_graph(graph, site.content)
    files: dict[Path, Track | None] = dict.fromkeys([*clouds, *grid, heights, graph])
    tracks = name_tracks(site, covariance=covariance)
    for name, (session, part, frames) in tracks.items():
        poses = frames.poses
        if frame == "utm" and part not in origins:
            logger.warning("%s: part %d of the map is not on the globe: left out", session, part)
            continue
        if frame == "utm":
            code = utm_code(next(iter(origins.values())))
            name, poses = f"{name}.epsg{code}", utm_poses(poses, origins[part], code)
        kinds = ["tum", "kitti"]
        write_poses_tum(target / f"{name}.tum", frames.stamps_ns, poses)
        write_poses_kitti(target / f"{name}.kitti", poses)
        if covariance:
            _write_covariances(target / f"{name}.csv", frames._replace(poses=poses))
            kinds.append("csv")
        files |= {target / f"{name}.{kind}": Track(session, part, frames) for kind in kinds}
    if origins:
        path = target / "trajectory.geojson"
        placed = [
            (each.session, each.frames.stamps_ns, each.frames.poses, origins[each.part])
            for each in tracks.values()
            if each.part in origins
        ]
        write_geojson(path, placed)
        files[path] = None
    return files


def name_tracks(site: PlaceMap, *, covariance: bool = False) -> dict[str, Track]:
    """Return poses of all frames, by the name of their files.

    That is the session's, for a part of the map other than its first one with the part's number. A
    name that cannot be a file's is replaced by a similar one, with a number if it is taken.

    Args:
        site: the map.
        covariance: whether poses have covariances.
    """
    wanted = []
    for session in site.sessions:
        frames = frame_poses(site, session.name, covariance=covariance)
        for part in session.parts:
            name = session.name if part == session.parts[0] else f"{session.name}-part-{part}"
            chosen = np.flatnonzero(frames.parts == part)
            wanted.append((name, Track(session.name, part, frames.select(chosen))))
    tracks: dict[str, Track] = {}
    for name, track in sorted(wanted, key=lambda each: _file_name(each[0]) != each[0]):
        similar = _file_name(name)
        numbered = (f"{similar}-{number}" for number in count(2))
        tracks[next(free for free in chain([similar], numbered) if free not in tracks)] = track
    return tracks


def _write_covariances(path: PathLike, frames: FramePoses) -> None:
    """Write poses and the upper triangles of their covariances as a table."""
    upper = np.triu_indices(6)
    axes = ("x", "y", "z", "rx", "ry", "rz")
    names = [f"cov_{axes[row]}_{axes[column]}" for row, column in zip(*upper, strict=True)]
    assert frames.covariances is not None
    with atomic_path(path) as temporary, temporary.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["frame", "stamp_ns", *POSE_NAMES, "keyframe", *names])
        for row, number in enumerate(frames.numbers.tolist()):
            values = [f"{value:.9g}" for value in frames.covariances[row][upper]]
            pose = pose_texts(frames.poses[row])
            writer.writerow([number, frames.stamps_ns[row], *pose, frames.keyframes[row], *values])


def _warn_of_optical(site: PlaceMap) -> None:
    """Warn of clouds in which z does not seem to point up: grid and heights are a slice of them."""
    known = site.content.keyframes
    rows = np.linspace(0, len(known) - 1, min(len(known), _MOST_COMPARED)).astype(int)
    seen = [known[row] for row in rows if np.array_equal(known[row].robot_from_cloud, np.eye(4))]
    clouds = (unpack_cloud(site.file.cloud(each.id).points).points for each in seen)
    count = sum(map(looks_along_z, clouds))
    if count > len(rows) / 2:
        logger.warning(
            "%s: %d of %d keyframes: %s: grid.pgm and heights.asc are a vertical slice; build the "
            "map anew with robot_from_points in a calib.yaml and fusion.frame=robot",
            *(site.path, count, len(rows), OPTICAL),
        )


def pose_texts(pose: Matrix) -> list[str]:
    """Return a pose (4, 4) as a table has it: ``POSE_NAMES``, metres and a quaternion."""
    values = [*pose[:3, 3], *Rotation.from_matrix(pose[:3, :3]).as_quat()]
    return [f"{value:.6f}" for value in values]


def _file_name(name: str) -> str:
    """A session's name with nothing that a file's name cannot have."""
    return "".join(each if each.isalnum() or each in "-_." else "_" for each in name)
