# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The places that are served: those of a folder of ``fusionslam fleet``, as they are now."""

import asyncio
import logging
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from fusionslam.base.arrays import Floats32
from fusionslam.errors import FusionSlamError
from fusionslam.fleet.chunk import CHUNKS, ChunkStore, PlaceCloud
from fusionslam.fleet.config import FILE, FleetSettings
from fusionslam.fleet.folder import DATABASE, FleetFolder
from fusionslam.fleet.joint_map import JointMap
from fusionslam.fleet.localization import FleetLocalization, FleetLocator
from fusionslam.fleet.place_database import PlaceDatabase, Positions
from fusionslam.fleet.places import Candidate, PlaceFilter
from fusionslam.sensors.frame import Cloud
from fusionslam.service.joint_maps import JointMaps
from fusionslam.service.problems import RequestError

logger = logging.getLogger(__name__)

_Identity = tuple[int, ...]


@dataclass(frozen=True)
class _Opened:
    """A folder that is open, and what tells it from another one of the same name."""

    identity: _Identity
    settings: FleetSettings
    database: PlaceDatabase
    store: ChunkStore
    locator: FleetLocator


class ServedPlaces:
    """Reads a folder of places that others may write to, or put another one in the place of.

    Methods may be called from several threads. They raise ``RequestError`` (503, code "places")
    while the folder cannot be read, and go on once it can.

    Args:
        folder: of ``fusionslam fleet describe``.

    Raises:
        DataError: it is no such folder, or it is damaged.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._lock = threading.Lock()
        self._maps = JointMaps(folder)
        self._opened = self._open()

    def __len__(self) -> int:
        with self._reading() as opened:
            return len(opened.database)

    @property
    def descriptor(self) -> str:
        """Name of the descriptor, with its preset."""
        return self._opened.settings.names[0]

    @property
    def length(self) -> int:
        """Length of its vectors."""
        return self._opened.database.settings.length

    @property
    def proves(self) -> bool:
        """Whether the clouds of places are stored, with which a query is proven."""
        return self._opened.settings.fleet.clouds and (self._folder / CHUNKS).is_dir()

    def describe(self, cloud: Cloud) -> Floats32:
        """Describe a scan as those of the places were; float32 (D,).

        Raises:
            DataError: it cannot be described.
        """
        return self._opened.locator.describe(cloud)

    def query(
        self, vectors: Floats32, k: int = 10, where: PlaceFilter | None = None
    ) -> list[list[Candidate]]:
        """Return the k nearest places of each of some vectors (n, D), nearest first."""
        with self._reading() as opened:
            return opened.database.query(vectors, k, where)

    def locate(self, cloud: Cloud, k: int, where: PlaceFilter) -> FleetLocalization:
        """Find a scan like those of the places, and prove it by registration.

        Raises:
            DataError: the cloud cannot be described.
            RequestError: the clouds of places are not stored (501, code "no-clouds").
        """
        if not self.proves:
            message = "the clouds of these places are not stored: nothing can be proven"
            raise RequestError(501, message, code="no-clouds")
        return self._opened.locator.localize(cloud, k, where)

    def cloud(self, key: str) -> PlaceCloud:
        """Return the cloud of a place, for the locator, which does without those that fail."""
        with self._reading() as opened:
            store = opened.store
        return store.cloud(key)

    def count_by(self, column: str) -> dict[str, int]:
        """Return numbers of places by site, region, robot or session."""
        with self._reading() as opened:
            return opened.database.count_by(column)

    def positions(self, site: str, most: int) -> Positions:
        """Return where the places of a site are, every n-th of more than so many."""
        with self._reading() as opened:
            return opened.database.positions(site, most)

    def joint_map(self, site: str) -> JointMap | None:
        """Return the joint map of a site; None if there is none that can be read."""
        return self._maps.get(site)

    def close(self) -> None:
        """Let go of the folder."""
        self._opened.database.close()

    @contextmanager
    def _reading(self) -> Iterator[_Opened]:
        """Yield the folder as it is now; what cannot be read is not the client's fault."""
        try:
            yield self._current()
        except RequestError:
            raise
        except (FusionSlamError, OSError) as error:
            logger.warning("%s cannot be read: %s", self._folder, error)
            message = "the places cannot be read now; the log of the service says why"
            headers = {"Retry-After": "5"}
            raise RequestError(503, message, code="places", headers=headers) from error

    def _current(self) -> _Opened:
        """Return the open folder; another one of its name is opened instead."""
        if self._identity() != self._opened.identity:
            with self._lock:
                if self._identity() != self._opened.identity:
                    self._opened = self._open()
        return self._opened

    def _open(self) -> _Opened:
        folder = FleetFolder.open(self._folder)
        identity = self._identity()
        locator = FleetLocator(self, self, folder.settings)
        return _Opened(identity, folder.settings, folder.database(), folder.store, locator)

    def _identity(self) -> _Identity:
        """Return numbers that stay the same while places are added."""
        settings, database = (self._folder / FILE).stat(), (self._folder / DATABASE).stat()
        return settings.st_ino, settings.st_ctime_ns, database.st_ino


class PlaceCount:
    """Counts places in a thread of its own, so that heavy queries do not delay it.

    Whoever asks while they are counted gets that number, too: nobody, not even without a key, can
    keep more than this thread busy. To be used from the event loop only.

    Args:
        places: that are counted.
    """

    def __init__(self, places: ServedPlaces) -> None:
        self._places = places
        self._pool = ThreadPoolExecutor(1, "fusionslam-count")
        self._counting: asyncio.Future[int | None] | None = None

    async def get(self) -> int | None:
        """Return the number of places; None if they cannot be read."""
        if self._counting is None or self._counting.done():
            loop = asyncio.get_running_loop()
            self._counting = loop.run_in_executor(self._pool, self._count)
        return await asyncio.shield(self._counting)  # the client may be gone before

    def close(self) -> None:
        """End the thread."""
        self._pool.shutdown(wait=True, cancel_futures=True)

    def _count(self) -> int | None:
        try:
            return len(self._places)
        except FusionSlamError:
            return None
