# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The unit of work: some frames of a recording, described and stored in one file.

A chunk may be worked on more than once, as after a worker died; its file is there once, since its
name says what is in it and it is renamed into place.
"""

import hashlib
import json
import logging
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fusionslam.datasets import Dataset
from fusionslam.descriptors import describe, for_clouds, length_of
from fusionslam.errors import DataError, FusionSlamError
from fusionslam.fleet.config import FleetSettings
from fusionslam.fleet.recordings import FleetRecording
from fusionslam.fusion import fuse, load_sensors, robot_from_cloud
from fusionslam.loop_closure.observation import fusion_of_scans, prepare_cloud
from fusionslam.pipelines.place_maps import has_odometry, odometry_of
from fusionslam.sensors.frame import Cloud, Frame
from fusionslam.storage.archive import load_archive, save_archive
from fusionslam.storage.arrays import Floats, Mask, Matrix
from fusionslam.views.scene_set import pack_bytes

FORMAT = "fusionslam.fleet_chunk.1"
CHUNKS = "chunks"

logger = logging.getLogger(__name__)

_UNKNOWN = np.full((4, 4), np.nan)


@dataclass(frozen=True)
class Chunk:
    """Some frames of a recording.

    Attributes:
        recording: that they are of.
        first, count: of the frames, as indices of the opened dataset.
        key: name of the content: of the input, the range, the settings and the version.
    """

    recording: FleetRecording
    first: int
    count: int
    key: str

    def path(self, folder: Path) -> Path:
        """Return the file of the chunk in a folder of ``fleet describe``."""
        return chunk_path(folder, self.key)

    def place_key(self, row: int) -> str:
        """Return the key of a place, by its row among the frames that were described."""
        return f"{self.key}:{row}"

    def __str__(self) -> str:
        return f"{self.recording.session}, frames {self.first} to {self.first + self.count - 1}"


def chunk_path(folder: Path, key: str) -> Path:
    """Return the file of a chunk, by its key."""
    return folder / CHUNKS / key[:2] / f"{key}.npz"


def cut_recording(
    recording: FleetRecording, frames: int, content: str, settings: FleetSettings
) -> list[Chunk]:
    """Cut a recording into chunks.

    Args:
        recording: to cut.
        frames: number of its frames.
        content: name of its content, as of ``digest_input``.
        settings: of the folder.
    """
    size, digest = settings.fleet.chunk, settings.digest
    chunks = []
    for first in range(0, frames, size):
        count = min(size, frames - first)
        about = {name: getattr(recording, name) for name in ("session", "robot", "site", "region")}
        identity = json.dumps([content, about, first, count, digest], sort_keys=True)
        key = hashlib.sha256(identity.encode()).hexdigest()[:32]
        chunks.append(Chunk(recording, first, count, key))
    return chunks


def describe_chunk(chunk: Chunk, settings: FleetSettings, folder: Path) -> None:
    """Describe the frames of a chunk, and write its file; nothing if it is there.

    Frames that cannot be described are left out; the file has their numbers and the reasons.

    Raises:
        DataError: the recording cannot be opened, or the file not be written.
    """
    path = chunk.path(folder)
    if path.exists():
        return
    opened = _open(json.dumps(chunk.recording.dump()), settings.fusion.source)
    frames = [_Frame.of(opened, index) for index in range(chunk.first, chunk.first + chunk.count)]
    chosen = _choose_places([frame.place for frame in frames], settings)
    described = [
        _describe(frame, settings, with_cloud=bool(is_place) and settings.fleet.clouds)
        for frame, is_place in zip(frames, chosen, strict=True)
    ]
    about = {"session": chunk.recording.session, "first": chunk.first, "count": chunk.count}
    about |= {name: getattr(chunk.recording, name) for name in ("robot", "site", "region")}
    save_archive(path, FORMAT, about, _arrays(frames, described, chosen, settings))


class _Opened(NamedTuple):
    """A recording that is open, and odometry of its frames if they do not have their own."""

    dataset: Dataset
    odometry: Floats | None


@lru_cache(maxsize=4)
def _open(recording: str, source: str) -> _Opened:
    """Open a recording in JSON; workers keep some open, as the next chunk often is of the same."""
    dataset = FleetRecording.load(json.loads(recording)).recording.open(source)
    return _Opened(dataset, odometry_of(dataset, "recorded") if has_odometry(dataset) else None)


class _Frame(NamedTuple):
    """A frame that is still to be read: its row in the recording, pose and odometry."""

    dataset: Dataset
    row: int
    pose: Matrix
    odometry: Matrix

    @classmethod
    def of(cls, opened: _Opened, index: int) -> "_Frame":
        dataset, odometry = opened
        pose, moved = _UNKNOWN, _UNKNOWN
        if dataset.true_poses is not None:
            pose = dataset.true_poses[index] @ dataset.body_from_robot
        if odometry is not None:
            moved = odometry[index]
        elif (own := dataset[index].odometry) is not None:
            moved = own
        return cls(dataset, index, pose, moved)

    @property
    def place(self) -> Matrix:
        """Where the robot is, by odometry or else in truth; NaN if it is not known."""
        return self.odometry if np.isfinite(self.odometry).all() else self.pose


def _choose_places(poses: list[Matrix], settings: FleetSettings) -> Mask:
    """Bool (n): the frames that become places, far enough from the last one of the chunk."""
    fleet = settings.fleet
    chosen: Mask = np.ones(len(poses), np.bool_)
    last: Matrix | None = None
    for row, pose in enumerate(poses):
        if last is not None and fleet.keyframe_distance:
            chosen[row] = not _is_near(last, pose, fleet.keyframe_distance, fleet.keyframe_turn)
        if chosen[row]:
            last = pose
    return chosen


def _is_near(last: Matrix, pose: Matrix, distance: float, turn: float) -> bool:
    """Whether a pose is no farther from the last one; false if either is unknown."""
    step = np.linalg.inv(last) @ pose if np.isfinite(last).all() else _UNKNOWN
    cosine = np.clip((np.trace(step[:3, :3]) - 1) / 2, -1, 1)
    return bool(np.linalg.norm(step[:3, 3]) < distance and np.degrees(np.arccos(cosine)) < turn)


class _Described(NamedTuple):
    """What a frame became, or why it could not be described."""

    vectors: Mapping[str, NDArray[np.float32]]
    points: int = 0
    cloud: bytes | None = None
    image: bytes | None = None
    ground_level: float = np.nan
    mount: Matrix = _UNKNOWN
    reason: str | None = None


def _describe(frame: _Frame, settings: FleetSettings, *, with_cloud: bool) -> _Described:
    try:
        read = frame.dataset[frame.row]
        load_sensors(read, settings.fusion)
        cloud = fuse(read, settings.fusion)
        vectors = _describe_cloud(cloud, read, settings)
        found = _Described(vectors, len(cloud), mount=robot_from_cloud(read, settings.fusion))
        return _keep_cloud(found, read, cloud, settings) if with_cloud else found
    except DataError as error:
        return _Described({}, reason=str(error))


def _describe_cloud(
    cloud: Cloud, frame: Frame, settings: FleetSettings
) -> dict[str, NDArray[np.float32]]:
    """Describe a cloud by each descriptor; zeros by those that cannot, unless none can."""
    vectors, problem = {}, None
    for name in settings.names:
        config = for_clouds(settings.descriptors, name, settings.fusion, frame)
        try:
            vectors[name] = describe(cloud, name, config)
        except DataError as error:
            problem = error
            vectors[name] = np.zeros(length_of(name, config), np.float32)
    if problem is not None and not any(vector.any() for vector in vectors.values()):
        raise problem
    return vectors


def _keep_cloud(
    found: _Described, frame: Frame, cloud: Cloud, settings: FleetSettings
) -> _Described:
    """Add the cloud as registration takes it."""
    scans = fusion_of_scans(settings.fusion, settings.registration)
    whole = cloud if scans == settings.fusion else fuse(frame, scans)
    kept = prepare_cloud(whole, cloud, settings.registration, fits_lengths=False, is_first=False)
    image = kept.search_image if kept.has_search_image else None
    return found._replace(
        cloud=kept.to_bytes(),
        image=None if image is None else image.bits,
        ground_level=np.nan if image is None else image.ground_level,
    )


def _arrays(
    frames: list[_Frame], described: list[_Described], chosen: Mask, settings: FleetSettings
) -> dict[str, NDArray[Any] | None]:
    """Return what a chunk's file holds: of the frames that were described, and of the others."""
    dataset = frames[0].dataset
    is_good = np.array([each.reason is None for each in described])
    rows = np.array([frame.row for frame in frames], np.int64)
    good = [each for each in described if each.reason is None]
    kept = [each.cloud for each in good if each.cloud is not None]
    images = [np.frombuffer(each.image, np.uint8) for each in good if each.image is not None]
    clouds, offsets = pack_bytes(kept)
    arrays: dict[str, NDArray[Any] | None] = {
        "rows": rows[is_good],
        "frames": dataset.numbers[rows[is_good]],
        "stamps_ns": dataset.stamps_ns[rows[is_good]],
        "poses": np.array([frame.pose for frame in frames]).reshape(-1, 4, 4)[is_good],
        "odometry": np.array([frame.odometry for frame in frames]).reshape(-1, 4, 4)[is_good],
        "is_place": chosen[is_good],
        "points": np.array([each.points for each in good], np.int64),
        "robot_from_cloud": np.array([each.mount for each in good]).reshape(-1, 4, 4),
        "has_cloud": np.array([each.cloud is not None for each in good], np.bool_),
        "clouds": clouds,
        "offsets": offsets,
        "images": np.array(images) if images else None,
        "ground_levels": np.array([each.ground_level for each in good if each.cloud is not None]),
        "bad": dataset.numbers[rows[~is_good]],
        "reasons": np.array([each.reason for each in described if each.reason is not None], str),
    }
    for name in settings.names:
        vectors = [each.vectors[name] for each in good]
        arrays[f"vectors.{name}"] = np.array(vectors) if vectors else None
    return arrays


class StoredChunk(NamedTuple):
    """The content of a chunk's file: what it is about, and its arrays.

    Attributes:
        about: session, robot, site, region, first and count.
        arrays: by name. Of the n frames that were described: "rows", "frames", "stamps_ns",
            "points" int64 (n); "poses", "odometry", "robot_from_cloud" float64 (n, 4, 4), NaN
            where unknown; "is_place", "has_cloud" bool (n); "vectors.NAME" float32 (n, D). The
            packed "clouds" with their "offsets", "images" and "ground_levels". Of the others:
            "bad", their numbers, and "reasons".
    """

    about: Mapping[str, Any]
    arrays: Mapping[str, NDArray[Any]]

    @classmethod
    def load(cls, path: Path) -> "StoredChunk":
        """Read a chunk. Raises DataError: it is missing, damaged or of another format."""
        with load_archive(path, FORMAT, "a chunk of fleet describe") as (about, arrays):
            return cls(about, arrays)

    @property
    def skipped(self) -> dict[int, str]:
        """Reasons by number of the frames that could not be described."""
        numbers, reasons = self.arrays["bad"].tolist(), self.arrays["reasons"].tolist()
        return dict(zip(numbers, reasons, strict=True))


def explain_failure(error: BaseException) -> tuple[str, str]:
    """Return code and text of what kept a chunk from being described."""
    if isinstance(error, FusionSlamError):
        return error.code, str(error)
    return "crash", f"{type(error).__name__}: {error}"
