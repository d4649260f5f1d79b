# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""A folder of places: the recordings of a fleet, described, searched and forgotten."""

import logging
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from fusionslam.base.archive import load_json, save_json
from fusionslam.base.progress import Progress
from fusionslam.base.write_lock import lock_folder
from fusionslam.descriptors import find_descriptor, length_of
from fusionslam.errors import ConfigError, DataError
from fusionslam.fleet.chunk import Chunk, ChunkStore, chunk_path, places_of
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

logger = logging.getLogger(__name__)

DATABASE = "database"
FORGOTTEN, FORGOTTEN_FORMAT = "forgotten.json", "fusionslam.fleet_forgotten.1"
_TAKEN_TOGETHER = 1000
"""Places that are added by one transaction."""
PATIENCE_S = 600.0
"""How long another process that changes the database is waited for, seconds."""
_PAUSE_S = 0.5


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

    def database(self, *, read_only: bool = True, patience_s: float | None = None) -> PlaceDatabase:
        """Open the database of places; one to be written is made if there is none.

        Args:
            read_only: whether nothing is changed.
            patience_s: how long another process that changes it is waited for; None for
                ``PATIENCE_S``.

        Raises:
            DataError: it is damaged, there is none to be read, or another process changes it for
                longer (code "locked").
            ConfigError: it is of another descriptor, or the descriptor has no vectors that a
                database can search.
        """
        patience_s = PATIENCE_S if patience_s is None else patience_s
        end, has_said = time.monotonic() + patience_s, not patience_s
        while True:
            try:
                return self._open_database(read_only)
            except DataError as error:
                if error.code != "locked":
                    raise
                if time.monotonic() >= end:
                    raise DataError(
                        f"{self.path / DATABASE} is still being changed by another process "
                        f"after {patience_s:g} s of waiting: try again later",
                        code="locked",
                        fields=(str(self.path / DATABASE),),
                    ) from error
                if not has_said:
                    logger.warning("%s is being changed: waiting", self.path / DATABASE)
                    has_said = True
            time.sleep(_PAUSE_S)

    def _open_database(self, read_only: bool) -> PlaceDatabase:
        location, settings, name = self.path / DATABASE, self.settings, self.settings.names[0]
        config = {
            "fusion": settings.fusion.model_dump(mode="json"),
            "descriptors": settings.descriptors.model_dump(mode="json", exclude={"threads"}),
        }
        length = length_of(name, settings.descriptors)
        expected = DatabaseSettings(name, length, find_descriptor(name).metric, config)
        if not read_only and not has_table(str(location)):
            return PlaceDatabase.create(location, expected)
        return PlaceDatabase.open(location, expected=expected, read_only=read_only)

    def locator(self, database: PlaceDatabase, loops: LoopConfig | None = None) -> FleetLocator:
        """Return what finds clouds in a database of this folder."""
        return FleetLocator(database, self.store, self.settings, loops)

    def describe(
        self, plan: Plan, engine: Engine, *, progress: Progress | None = None
    ) -> list[Failure]:
        """Describe what is missing of a plan, and add its places to the database.

        Recordings that were forgotten stay so, those that are forgotten meanwhile, too. Places of
        one that has changed stay until the new ones are there. Other processes may change the
        database meanwhile; places that cannot be added are in chunks, and the next run adds them.

        Args:
            plan: all work; it is stored.
            engine: runs the work.
            progress: called with (frames done, total).

        Returns:
            What failed, as ``failed.jsonl`` has it.

        Raises:
            DataError: another process describes, or changes the database for long (code "locked");
                or the folder is damaged or cannot be written.
        """
        lock = lock_folder(self.path)
        try:
            with self.database(read_only=False) as database:
                plan, forgotten = self._join(plan)
                for each in forgotten:
                    self._forget_recording(database, each)
                plan.save(self.path)
                taker = _Taker(self, database, plan)
            failures = describe_recordings(
                plan, self.settings, self.path, engine, progress=progress, taker=taker
            )
            problem = self._finish(plan, taker)
        finally:
            lock.release()
        if problem is not None:
            failures.append(problem)
            add_failure(self.path, problem)
        return failures

    def _finish(self, plan: Plan, taker: "_Taker") -> Failure | None:
        """Add the last places, and delete what is outdated or was forgotten meanwhile."""
        try:
            database = self.database(read_only=False)
        except DataError as error:
            if error.code != "locked":
                raise
            if taker.waits or plan.outdated:
                taker.leave_out(error)
            return taker.problem
        with database:
            taker.flush(database)
            plan, forgotten = self._without_forgotten(plan)
            for each in forgotten:  # workers may have described more of it since
                self._forget_recording(database, each)
            self._delete_outdated(plan, database)
        return taker.problem

    def _join(self, plan: Plan) -> tuple[Plan, list[PlannedRecording]]:
        """Return the plan with all known recordings, and those that were forgotten meanwhile."""
        plan, left = self._without_forgotten(plan)
        for each in left:  # what a killed run may have described after it was forgotten
            self._delete_chunks(each)
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
            DataError: the list of recordings is damaged; nothing is deleted then.
        """
        named = PlaceFilter(where.site, where.region, where.robot, where.session)
        if where.is_any or where != named:
            raise ConfigError(
                "expected a robot, session, site or region to forget: whole recordings are",
                code="choice",
                fields=("forget",),
            )
        with self.database(read_only=False) as database:
            listed = Plan.load(self.path) if (self.path / PLAN).exists() else None
            save_json(
                self.path / FORGOTTEN,
                FORGOTTEN_FORMAT,
                {"filters": [asdict(each) for each in [*self.forgotten(), where]]},
            )
            count = database.delete(where)
            # Done again by the next ``describe`` if this is interrupted.
            if listed is not None:
                plan, forgotten = self._without_forgotten(listed)
                for each in forgotten:
                    self._forget_recording(database, each)
                # What a ``describe`` that runs now writes of them later is deleted with these.
                replace(plan, outdated=[*plan.outdated, *forgotten]).save(self.path)
        return count

    def forgotten(self) -> list[PlaceFilter]:
        """Return what was forgotten, which is not described again."""
        path = self.path / FORGOTTEN
        if not path.exists():
            return []
        with load_json(path, FORGOTTEN_FORMAT, "what a fleet forgot") as values:
            return [PlaceFilter(**each) for each in values["filters"]]


def _matches_any(recording: FleetRecording, filters: Sequence[PlaceFilter]) -> bool:
    return any(
        all(getattr(each, name) in (None, getattr(recording, name)) for name in ABOUT)
        for each in filters
    )


class _Taker:
    """Adds the places of chunks to a database, many by one transaction.

    The database is opened for each, so that other processes may change it in between.

    Attributes:
        problem: what could not be added, and why; None if all was.
    """

    def __init__(self, folder: FleetFolder, database: PlaceDatabase, plan: Plan) -> None:
        self._folder, self._store = folder, folder.store
        # The first frame that is described is a place, but for rare ones, which are added again.
        firsts = [f"{key}:0" for each in plan.recordings for key in each.keys]
        self._known = database.known_keys(firsts)
        self._waiting: list[tuple[FleetRecording, Places]] = []
        self._left_out = 0
        self.problem: Failure | None = None

    def take(self, chunk: Chunk) -> Mapping[int, str] | None:
        """Add the places of a chunk, now or later, unless they are there; as of ``ChunkTaker``."""
        if chunk.place_key(0) in self._known:
            return None
        try:
            stored = self._store.read(chunk.key)
        except DataError:
            if _matches_any(chunk.recording, self._folder.forgotten()):
                return {}  # its file was deleted since it was described
            raise
        self._waiting.append((chunk.recording, places_of(stored, self._folder.settings)))
        if sum(len(places) for _, places in self._waiting) >= _TAKEN_TOGETHER:
            self._try_to_flush()
        return stored.skipped

    @property
    def waits(self) -> bool:
        """Whether places wait to be added."""
        return bool(self._waiting)

    def _try_to_flush(self) -> None:
        """Add what waits, unless another process changes the database: workers go on meanwhile."""
        try:
            with self._folder.database(read_only=False, patience_s=0) as database:
                self.flush(database)
        except DataError as error:
            if error.code != "locked":
                self.leave_out(error)

    def flush(self, database: PlaceDatabase) -> None:
        """Add what waits, but for what was forgotten meanwhile.

        What cannot be added is in chunks, and is added by the next run.
        """
        forgotten = self._folder.forgotten()
        kept = [one for about, one in self._waiting if not _matches_any(about, forgotten)]
        try:
            if (places := join_places(kept)) is not None:
                database.add(places)
            self._waiting.clear()
        except DataError as error:
            self.leave_out(error)

    def leave_out(self, error: DataError) -> None:
        """Note why places that wait are not added, or outdated ones not deleted."""
        self._left_out += sum(len(places) for _, places in self._waiting)
        self._waiting.clear()
        what = (
            f"{self._left_out} places are not added"
            if self._left_out
            else "outdated ones are not deleted"
        )
        reason = f"{what} yet: {error}; the next run does it"
        location = str(self._folder.path / DATABASE)
        self.problem = Failure(location, None, None, error.code, reason)
