# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""A folder of places: the recordings of a fleet, described, searched and forgotten."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from fusionslam.descriptors import find_descriptor, length_of
from fusionslam.errors import ConfigError
from fusionslam.fleet.chunk import Chunk, chunk_path
from fusionslam.fleet.chunk_store import ChunkStore
from fusionslam.fleet.config import FleetSettings
from fusionslam.fleet.engines import Engine
from fusionslam.fleet.localization import FleetLocator
from fusionslam.fleet.place_database import DatabaseSettings, PlaceDatabase
from fusionslam.fleet.places import ABOUT, PlaceFilter, join_places
from fusionslam.fleet.recordings import FleetRecording
from fusionslam.fleet.work import PLAN, Failure, Plan, PlannedRecording, describe_recordings
from fusionslam.loop_closure.config import LoopConfig
from fusionslam.storage.archive import load_json, save_json
from fusionslam.storage.progress import Progress

DATABASE = "database"
FORGOTTEN, FORGOTTEN_FORMAT = "forgotten.json", "fusionslam.fleet_forgotten.1"
_TAKEN_TOGETHER = 1000
"""Places that are added by one transaction."""


@dataclass(frozen=True)
class FleetFolder:
    """The results of ``fleet describe``.

    Attributes:
        path: of the folder.
        settings: what its places share.
    """

    path: Path
    settings: FleetSettings

    @classmethod
    def open(cls, path: Path) -> "FleetFolder":
        """Open a folder that exists.

        Raises:
            DataError: it is none, or damaged.
        """
        return cls(path, FleetSettings.load(path))

    @property
    def store(self) -> ChunkStore:
        """The chunks."""
        return ChunkStore(self.path, self.settings)

    def database(self, *, read_only: bool = True) -> PlaceDatabase:
        """Open the database of places; one to be written is made if there is none.

        Raises:
            DataError: it is damaged, or there is none to be read.
            ConfigError: it is of another descriptor, or the descriptor has no vectors that a
                database can search.
        """
        location, expected = self.path / DATABASE, self._database_settings
        if not read_only and not location.exists():
            return PlaceDatabase.create(location, expected)
        return PlaceDatabase.open(location, expected=expected, read_only=read_only)

    @property
    def _database_settings(self) -> DatabaseSettings:
        settings, name = self.settings, self.settings.names[0]
        config = {
            "fusion": settings.fusion.model_dump(mode="json"),
            "descriptors": settings.descriptors.model_dump(mode="json", exclude={"threads"}),
        }
        length = length_of(name, settings.descriptors)
        return DatabaseSettings(name, length, find_descriptor(name).metric, config)

    def locator(self, database: PlaceDatabase, loops: LoopConfig | None = None) -> FleetLocator:
        """Return what finds clouds in a database of this folder."""
        return FleetLocator(database, self.store, self.settings, loops)

    def describe(
        self, plan: Plan, engine: Engine, *, progress: Progress | None = None
    ) -> list[Failure]:
        """Describe what is missing of a plan, and add its places to the database.

        Recordings that were forgotten stay so.

        Args:
            plan: all work; it is stored.
            engine: runs the work.
            progress: called with (frames done, total).

        Returns:
            What failed, as ``failed.jsonl`` has it.
        """
        plan, changed = self._join(plan)
        with self.database(read_only=False) as database:
            for each in changed:
                database.delete(PlaceFilter(session=each.recording.session))
                self._delete_chunks(each)
            plan.save(self.path)
            taker = _Taker(database, self.store)
            failures = describe_recordings(
                plan, self.settings, self.path, engine, progress=progress, take=taker.take
            )
            taker.flush()
        return failures

    def _join(self, plan: Plan) -> tuple[Plan, list[PlannedRecording]]:
        """Return all recordings that are not forgotten, and what has changed of those known."""
        forgotten = self.forgotten()
        kept = [each for each in plan.recordings if not _matches_any(each.recording, forgotten)]
        plan = Plan(plan.root, kept, plan.failures)
        known = (self.path / PLAN).exists()
        return plan.joined(Plan.load(self.path)) if known else (plan, [])

    def _delete_chunks(self, planned: PlannedRecording) -> None:
        for key in planned.keys:
            chunk_path(self.path, key).unlink(missing_ok=True)

    def forget(self, where: PlaceFilter) -> int:
        """Delete places for good: from the database, and the chunks of their recordings.

        Returns:
            How many places there were.

        Raises:
            ConfigError: the filter is empty, or it asks for times: whole recordings are forgotten.
        """
        _check_forgettable(where)
        with self.database(read_only=False) as database:
            save_json(
                self.path / FORGOTTEN,
                FORGOTTEN_FORMAT,
                {"filters": [asdict(each) for each in [*self.forgotten(), where]]},
            )
            count = database.delete(where)
        plan = Plan.load(self.path)
        kept = []
        for each in plan.recordings:
            if not _matches_any(each.recording, [where]):
                kept.append(each)
                continue
            self._delete_chunks(each)
        Plan(plan.root, kept, plan.failures).save(self.path)
        return count

    def forgotten(self) -> list[PlaceFilter]:
        """Return what was forgotten, which is not described again."""
        path = self.path / FORGOTTEN
        if not path.exists():
            return []
        with load_json(path, FORGOTTEN_FORMAT, "what a fleet forgot") as values:
            return [PlaceFilter(**each) for each in values["filters"]]


def _check_forgettable(where: PlaceFilter) -> None:
    named = PlaceFilter(where.site, where.region, where.robot, where.session)
    if where.is_any or where != named:
        raise ConfigError(
            "expected a robot, session, site or region to forget: whole recordings are",
            code="choice",
            fields=("forget",),
        )


def _matches_any(recording: FleetRecording, filters: Sequence[PlaceFilter]) -> bool:
    return any(
        all(getattr(each, name) in (None, getattr(recording, name)) for name in ABOUT)
        for each in filters
    )


class _Taker:
    """Adds the places of chunks to a database, many by one transaction."""

    def __init__(self, database: PlaceDatabase, store: ChunkStore) -> None:
        self._database, self._store = database, store
        self._waiting: list[Chunk] = []

    def take(self, chunk: Chunk) -> None:
        """Add the places of a chunk, now or later."""
        self._waiting.append(chunk)
        if sum(each.count for each in self._waiting) >= _TAKEN_TOGETHER:
            self.flush()

    def flush(self) -> None:
        """Add what waits, chunks that are there already excepted."""
        keys = [each.place_key(row) for each in self._waiting for row in range(each.count)]
        known = {key.partition(":")[0] for key in self._database.known_keys(keys)}
        new = [self._store.places(each.key) for each in self._waiting if each.key not in known]
        self._waiting.clear()
        if places := join_places(new):
            self._database.add(places)
