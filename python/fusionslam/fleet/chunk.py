# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The unit of work: some frames of a recording, described and stored in one file; its places.

A chunk may be worked on more than once, as after a worker died; its file is there once, since its
name says what is in it and it is renamed into place.
"""

import hashlib
import json
import math
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fusionslam.base.archive import load_archive, save_archive
from fusionslam.base.arrays import Floats, Matrix
from fusionslam.datasets import Dataset
from fusionslam.datasets.base import CAMERA_FROM_ROBOT_AXES
from fusionslam.errors import DataError, FusionSlamError
from fusionslam.fleet.config import FleetSettings
from fusionslam.fleet.places import ABOUT, Places
from fusionslam.fleet.recordings import FleetRecording
from fusionslam.fusion import load_sensors, robot_from_cloud
from fusionslam.geometry.keyframes import is_keyframe
from fusionslam.loop_closure.verification import StoredFrame
from fusionslam.pipelines.place_maps import odometry_of
from fusionslam.registration import PreparedCloud, SearchImage
from fusionslam.views.scene_set import pack_bytes

FORMAT = "fusionslam.fleet_chunk.1"
CHUNKS = "chunks"

_KEY = re.compile(r"[0-9a-f]{32}")
_END, _END_BYTES = b"PK\5\6", 22
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


def is_chunk_key(key: object) -> bool:
    """Whether it is a key as ``cut_recording`` makes them, which is safe as the name of a file."""
    return isinstance(key, str) and _KEY.fullmatch(key) is not None


def chunk_path(folder: Path, key: str) -> Path:
    """Return the file of a chunk, by its key; one from a file is checked by ``is_chunk_key``."""
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
        about = {name: getattr(recording, name) for name in ABOUT}
        identity = json.dumps([content, about, first, count, digest], sort_keys=True)
        key = hashlib.sha256(identity.encode()).hexdigest()[:32]
        chunks.append(Chunk(recording, first, count, key))
    return chunks


def is_stored(path: Path) -> bool:
    """Whether a chunk's file is there and not cut short; what is in it is checked when it is read.

    A ``.npz`` ends with a record of its own.
    """
    try:
        with path.open("rb") as file:
            file.seek(-_END_BYTES, os.SEEK_END)
            return file.read(len(_END)) == _END
    except OSError:
        return False


def describe_chunk(chunk: Chunk, settings: FleetSettings, folder: Path) -> None:
    """Describe the frames of a chunk, and write its file; nothing if it is there.

    Frames that cannot be described are left out; the file has their numbers and the reasons.

    Raises:
        DataError: the recording cannot be opened, or the file not be written.
    """
    path = chunk.path(folder)
    if is_stored(path):
        return
    opened = _open(json.dumps(asdict(chunk.recording)), settings.fusion.source)
    if chunk.first + chunk.count > len(opened.dataset):
        raise DataError(
            f"{chunk}: there are {len(opened.dataset)} frames now: expected a recording that does "
            "not change meanwhile",
            code="changed",
            fields=(chunk.recording.session,),
        )
    described = _describe_all(opened, range(chunk.first, chunk.first + chunk.count), settings)
    about = {"key": chunk.key, "first": chunk.first, "count": chunk.count}
    about |= {name: getattr(chunk.recording, name) for name in ABOUT}
    save_archive(path, FORMAT, about, _arrays(opened.dataset, described, settings))


class _Opened(NamedTuple):
    """A recording that is open.

    Attributes:
        dataset: its frames.
        poses: float64 (N, 4, 4), true ones of the robot, z up; None if there are none.
        odometry: the same by odometry, if it is in a file of its own.
    """

    dataset: Dataset
    poses: Floats | None
    odometry: Floats | None


@lru_cache(maxsize=4)
def _open(recording: str, source: str) -> _Opened:
    """Open a recording in JSON; workers keep some open, as the next chunk often is of the same."""
    dataset = FleetRecording.load(json.loads(recording)).recording.open(source)
    poses = None
    if dataset.true_poses is not None:
        poses = dataset.true_poses @ dataset.body_from_robot
        if dataset.body_is_camera:  # and so is the world, as KITTI's
            poses = np.linalg.inv(CAMERA_FROM_ROBOT_AXES) @ poses
    odometry = None if dataset.odometry_topic is None else odometry_of(dataset, "recorded")
    return _Opened(dataset, poses, odometry)


def _describe_all(
    opened: _Opened, rows: Sequence[int], settings: FleetSettings
) -> "list[_Described]":
    """Describe frames in their order; those far enough from the last place become places."""
    done: list[_Described] = []
    last: Matrix | None = None
    for row in rows:
        found = _describe(opened, row, settings, last)
        if found.is_place:
            last = found.where
        done.append(found)
    return done


class _Described(NamedTuple):
    """What a frame became, or why it could not be described."""

    row: int
    pose: Matrix = _UNKNOWN
    odometry: Matrix = _UNKNOWN
    vectors: Mapping[str, NDArray[np.float32]] = {}
    is_place: bool = False
    points: int = 0
    mount: Matrix = _UNKNOWN
    cloud: bytes | None = None
    image: SearchImage | None = None
    reason: str | None = None

    @property
    def where(self) -> Matrix:
        """Where the robot is, by odometry or else in truth; NaN if it is not known."""
        return self.odometry if np.isfinite(self.odometry).all() else self.pose


def _describe(
    opened: _Opened, row: int, settings: FleetSettings, last: Matrix | None
) -> _Described:
    """Describe a frame; it becomes a place unless it is near the last one, or blank."""
    found, fleet = _Described(row), settings.fleet
    if opened.poses is not None:
        found = found._replace(pose=opened.poses[row])
    try:
        frame = opened.dataset[row]
        if opened.odometry is not None:
            found = found._replace(odometry=opened.odometry[row])
        elif frame.odometry is not None:
            found = found._replace(odometry=frame.odometry)
        is_far = True  # also where one of both poses is unknown
        if last is not None and fleet.keyframe_distance and np.isfinite([last, found.where]).all():
            step = np.linalg.inv(last) @ found.where
            is_far = is_keyframe(step, fleet.keyframe_distance, fleet.keyframe_turn)
        load_sensors(frame, settings.fusion)
        seen = settings.observer(settings.names, verifies=is_far and fleet.clouds).observe(frame)
        found = found._replace(
            vectors=seen.vectors,
            is_place=is_far and bool(seen.vectors[settings.names[0]].any()),
            points=seen.points,
            mount=robot_from_cloud(frame, settings.fusion),
        )
        if seen.cloud is None or not found.is_place:
            return found
        image = seen.cloud.search_image if seen.cloud.has_search_image else None
        return found._replace(cloud=seen.cloud.to_bytes(), image=image)
    except DataError as error:
        return _Described(row, reason=str(error))


def _arrays(
    dataset: Dataset, described: list[_Described], settings: FleetSettings
) -> dict[str, NDArray[Any] | None]:
    """Return what a chunk's file holds: of the frames that were described, and of the others."""
    good = [each for each in described if each.reason is None]
    bad = [each for each in described if each.reason is not None]
    rows = np.array([each.row for each in good], np.int64)
    kept = [each for each in good if each.cloud is not None]
    clouds, offsets = pack_bytes([each.cloud or b"" for each in kept])
    arrays: dict[str, NDArray[Any] | None] = {
        "rows": rows,
        "frames": dataset.numbers[rows],
        "stamps_ns": dataset.stamps_ns[rows],
        "poses": np.array([each.pose for each in good]).reshape(-1, 4, 4),
        "odometry": np.array([each.odometry for each in good]).reshape(-1, 4, 4),
        "is_place": np.array([each.is_place for each in good], np.bool_),
        "points": np.array([each.points for each in good], np.int64),
        "robot_from_cloud": np.array([each.mount for each in good]).reshape(-1, 4, 4),
        "has_cloud": np.array([each.cloud is not None for each in good], np.bool_),
        "clouds": clouds,
        "offsets": offsets,
        "images": _images(kept),
        "ground_levels": np.array(
            [np.nan if each.image is None else each.image.ground_level for each in kept]
        ),
        "bad": dataset.numbers[np.array([each.row for each in bad], np.int64)],
        "reasons": np.array([each.reason for each in bad], str),
    }
    for name in settings.names:
        vectors = [each.vectors[name] for each in good]
        arrays[f"vectors.{name}"] = np.array(vectors) if vectors else None
    return arrays


def _images(kept: list[_Described]) -> NDArray[np.uint8] | None:
    """Return the images from above of clouds, zeros for one without; None if none has one."""
    bits = [b"" if each.image is None else each.image.bits for each in kept]
    size = max(map(len, bits), default=0)
    if not size:
        return None
    return np.array([np.frombuffer(each or bytes(size), np.uint8) for each in bits])


class StoredChunk(NamedTuple):
    """The content of a chunk's file: what it is about, and its arrays.

    Attributes:
        about: key, session, robot, site, region, first and count.
        arrays: by name. Of the n frames that were described: "rows", "frames", "stamps_ns",
            "points" int64 (n); "poses", "odometry", "robot_from_cloud" float64 (n, 4, 4), NaN
            where unknown; "is_place", "has_cloud" bool (n); "vectors.NAME" float32 (n, D). The
            packed "clouds" with their "offsets", "images" and "ground_levels", NaN without an
            image. Of the others: "bad", their numbers, and "reasons".
    """

    about: Mapping[str, Any]
    arrays: Mapping[str, NDArray[Any]]

    @classmethod
    def load(cls, path: Path) -> "StoredChunk":
        """Read a chunk.

        Raises:
            DataError: it is missing, damaged, of another format or that of another chunk.
        """
        with load_archive(path, FORMAT, "a chunk of fleet describe") as (about, arrays):
            if about["key"] != path.stem:
                raise DataError(f"is the chunk {about['key']}", code="wrong-digest")
            return cls(about, arrays)

    @property
    def skipped(self) -> dict[int, str]:
        """Reasons by number of the frames that could not be described."""
        numbers, reasons = self.arrays["bad"].tolist(), self.arrays["reasons"].tolist()
        return dict(zip(numbers, reasons, strict=True))


_READY = 32
"""Chunks that are kept ready; each of 50 frames takes some 2 MB."""


class PlaceCloud(NamedTuple):
    """The cloud of a place.

    Attributes:
        frame: as the verification of loops takes it.
        robot_from_cloud: float64 (4, 4).
    """

    frame: StoredFrame
    robot_from_cloud: Matrix


class ChunkStore:
    """Reads the chunks of a folder.

    Args:
        folder: of ``fleet describe``.
        settings: of the folder.
    """

    def __init__(self, folder: Path, settings: FleetSettings) -> None:
        self._folder, self._settings = folder, settings
        self._load = lru_cache(maxsize=_READY)(self.read)

    def read(self, key: str) -> StoredChunk:
        """Read a chunk. Raises DataError: its file is missing or damaged."""
        return StoredChunk.load(chunk_path(self._folder, key))

    def has(self, key: str) -> bool:
        """Whether the file of a chunk is there."""
        return chunk_path(self._folder, key).exists()

    def places(self, key: str) -> Places:
        """Return the places of a chunk: those of its frames that became places.

        Args:
            key: of the chunk.

        Raises:
            DataError: its file is missing or damaged.
        """
        return places_of(self.read(key), self._settings)

    def cloud(self, key: str) -> PlaceCloud:
        """Return the cloud of a place.

        Args:
            key: of the place, CHUNK:ROW.

        Raises:
            DataError: there is none (code "no-cloud"), or its chunk is missing or damaged.
        """
        chunk_key, _, text = key.partition(":")
        if not is_chunk_key(chunk_key) or not text.isdecimal():
            raise DataError(
                f"place {key!r} is of no chunk: its cloud is not stored here",
                code="no-cloud",
                fields=(key,),
            )
        arrays, row = self._load(chunk_key).arrays, int(text)
        if row >= len(arrays["has_cloud"]) or not arrays["has_cloud"][row]:
            raise DataError(
                f"place {key} has no cloud: fleet.clouds=true keeps those of places",
                code="no-cloud",
                fields=(key,),
            )
        number = int(np.count_nonzero(arrays["has_cloud"][:row]))
        begin, end = arrays["offsets"][number : number + 2].tolist()
        packed = arrays["clouds"][begin:end].tobytes()
        odometry = arrays["odometry"][row]
        image, level = None, float(arrays["ground_levels"][number])
        if "images" in arrays and not math.isnan(level):
            image = SearchImage(arrays["images"][number].tobytes(), level)
        registration = self._settings.registration
        frame = StoredFrame(
            int(arrays["stamps_ns"][row]),
            odometry if np.isfinite(odometry).all() else None,
            image,
            lambda: PreparedCloud.from_bytes(packed, registration),
        )
        return PlaceCloud(frame, arrays["robot_from_cloud"][row])


def places_of(chunk: StoredChunk, settings: FleetSettings) -> Places:
    """Return the places of a chunk."""
    arrays, about = chunk.arrays, chunk.about
    rows = np.flatnonzero(arrays["is_place"])
    vectors = arrays.get(f"vectors.{settings.names[0]}", np.empty((0, 0), np.float32))
    odometry, truth = arrays["odometry"], arrays["poses"]
    known = np.isfinite(truth).all(axis=(1, 2), keepdims=True)
    return Places(
        keys=[f"{about['key']}:{row}" for row in rows.tolist()],
        vectors=vectors[rows],
        stamps_ns=arrays["stamps_ns"][rows],
        frames=arrays["frames"][rows],
        poses=np.where(known, truth, odometry)[rows],
        **{name: str(about[name]) for name in ABOUT},
    )


def explain_failure(error: BaseException) -> tuple[str, str]:
    """Return code and text of what kept a chunk from being described."""
    if isinstance(error, FusionSlamError):
        return error.code, str(error)
    return "crash", f"{type(error).__name__}: {error}"
