# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The chunks of a folder: their places for a database, and the clouds of these."""

import math
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from fusionslam.errors import DataError
from fusionslam.fleet.chunk import StoredChunk, chunk_path, is_chunk_key
from fusionslam.fleet.config import FleetSettings
from fusionslam.fleet.places import ABOUT, Places
from fusionslam.loop_closure.verification import StoredFrame
from fusionslam.registration import PreparedCloud, SearchImage
from fusionslam.storage.arrays import Matrix

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
