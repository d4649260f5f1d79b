# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""A folder of places: the recordings of a fleet, described, searched and forgotten."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from fusionslam.descriptors import find_descriptor, length_of
from fusionslam.errors import ConfigError, DataError
from fusionslam.fleet.chunk import Chunk, chunk_path
from fusionslam.fleet.chunk_store import ChunkStore, places_of
from fusionslam.fleet.config import FleetSettings
from fusionslam.fleet.engines import Engine
from fusionslam.fleet.lance_extra import has_table
from fusionslam.fleet.localization import FleetLocator
from fusionslam.fleet.place_database import DatabaseSettings, PlaceDatabase
from fusionslam.fleet.places import ABOUT, PlaceFilter, Places, join_places
from fusionslam.fleet.recordings import FleetRecording
from fusionslam.fleet.site_maps import forget_drive
from fusionslam.fleet.work import (
    PLAN,
    Failure,
    Plan,
    PlannedRecording,
    add_failure,
    describe_recordings,
)
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
        if not read_only and not has_table(str(location)):
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

        Recordings that were forgotten stay so. Places of one that has changed stay until the new
        ones are there.

        Args:
            plan: all work; it is stored.
            engine: runs the work.
            progress: called with (frames done, total).

        Returns:
            What failed, as ``failed.jsonl`` has it.
        """
        with self.database(read_only=False) as database:
            plan, forgotten = self._join(plan)
            for each in forgotten:
                self._forget_recording(database, each)
            plan.save(self.path)
            taker = _Taker(self, database, plan)
            failures = describe_recordings(
                plan, self.settings, self.path, engine, progress=progress, taker=taker
            )
            taker.flush()
            self._delete_outdated(plan, database)
        if taker.problem is not None:
            failures.append(taker.problem)
            add_failure(self.path, taker.problem)
        return failures

    def _join(self, plan: Plan) -> tuple[Plan, list[PlannedRecording]]:
        """Return the plan with all known recordings, and those that were forgotten meanwhile."""
        plan, _ = self._without_forgotten(plan)
        if not (self.path / PLAN).exists():
            return plan, []
        earlier, forgotten = self._without_forgotten(Plan.load(self.path))
        return plan.joined(earlier), forgotten

    def _forget_recording(self, database: PlaceDatabase, planned: PlannedRecording) -> None:
        database.delete(PlaceFilter(session=planned.recording.session))
        self._delete_chunks(planned)
        forget_drive(self.path, planned.recording)

    def _delete_outdated(self, plan: Plan, database: PlaceDatabase) -> None:
        """Delete what changed recordings had before, once all of what they have now is there."""
        now = {each.recording.session: each for each in plan.recordings}
        waiting = []
        for old in plan.outdated:
            new = now.get(old.recording.session)
            if new is not None and not all(map(self.store.has, new.keys)):
                waiting.append(old)
                continue
            kept = () if new is None else new.keys
            keys = [key for key in old.keys if key not in kept]
            size = self.settings.fleet.chunk
            database.delete_keys([f"{key}:{row}" for key in keys for row in range(size)])
            for key in keys:
                chunk_path(self.path, key).unlink(missing_ok=True)
        if len(waiting) < len(plan.outdated):
            replace(plan, outdated=waiting).save(self.path)

    def _without_forgotten(self, plan: Plan) -> tuple[Plan, list[PlannedRecording]]:
        """Return a plan without the recordings that were forgotten, and these."""
        filters = self.forgotten()
        forgotten = [each for each in plan.recordings if _matches_any(each.recording, filters)]
        kept = [each for each in plan.recordings if not _matches_any(each.recording, filters)]
        return replace(plan, recordings=kept), forgotten

    def _delete_chunks(self, planned: PlannedRecording) -> None:
        for key in planned.keys:
            chunk_path(self.path, key).unlink(missing_ok=True)

    def forget(self, where: PlaceFilter) -> int:
        """Delete places for good: from the database, with chunks and maps of their recordings.

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
            # Done again by the next ``describe`` if this is interrupted.
            if (self.path / PLAN).exists():
                plan, forgotten = self._without_forgotten(Plan.load(self.path))
                for each in forgotten:
                    self._forget_recording(database, each)
                plan.save(self.path)
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
    """Adds the places of chunks to a database, many by one transaction.

    Attributes:
        problem: what could not be added, and why; None if all was.
    """

    def __init__(self, folder: FleetFolder, database: PlaceDatabase, plan: Plan) -> None:
        self._settings, self._store, self._database = folder.settings, folder.store, database
        # The first frame that is described is a place, but for rare ones, which are added again.
        firsts = [f"{key}:0" for each in plan.recordings for key in each.keys]
        self._known = database.known_keys(firsts)
        self._waiting: list[Places] = []
        self._left_out = 0
        self.problem: Failure | None = None

    def take(self, chunk: Chunk) -> Mapping[int, str] | None:
        """Add the places of a chunk, now or later, unless they are there; as of ``ChunkTaker``."""
        if chunk.place_key(0) in self._known:
            return None
        stored = self._store.read(chunk.key)
        self._waiting.append(places_of(stored, self._settings))
        if sum(map(len, self._waiting)) >= _TAKEN_TOGETHER:
            self.flush()
        return stored.skipped

    def flush(self) -> None:
        """Add what waits; what cannot be added is in chunks, and is added by the next run."""
        places = join_places(self._waiting)
        self._waiting.clear()
        if places is None:
            return
        try:
            self._database.add(places)
        except DataError as error:
            self._left_out += len(places)
            reason = f"{self._left_out} places are not added yet: {error}"
            self.problem = Failure(self._database.location, None, None, error.code, reason)
