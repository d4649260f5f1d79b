# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Describes all recordings of a fleet, by many workers, and goes on where it stopped."""

import json
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from fusionslam.errors import DataError, FusionSlamError
from fusionslam.fleet.chunk import Chunk, chunk_path, cut_recording, describe_chunk, explain_failure
from fusionslam.fleet.config import FleetSettings
from fusionslam.fleet.engines import Engine
from fusionslam.fleet.recordings import FleetRecording, Found, digest_input
from fusionslam.storage.archive import load_json, save_json
from fusionslam.storage.files import atomic_path
from fusionslam.storage.progress import Progress

PLAN, PLAN_FORMAT = "recordings.json", "fusionslam.fleet_recordings.1"
FAILED = "failed.jsonl"


@dataclass(frozen=True)
class Failure:
    """What could not be done, and why.

    Attributes:
        session: name of the recording, or its path if it has none.
        first, count: of the chunk's frames; None for a whole recording.
        code, reason: of the error.
        tries: how often it was tried.
    """

    session: str
    first: int | None
    count: int | None
    code: str
    reason: str
    tries: int = 1

    def dump(self) -> dict[str, Any]:
        """Return everything as values for JSON."""
        return dict(vars(self))


@dataclass(frozen=True)
class PlannedRecording:
    """A recording and the keys of its chunks, in order."""

    recording: FleetRecording
    frames: int
    keys: tuple[str, ...]

    def chunks(self, size: int) -> list[Chunk]:
        """Return its chunks, of so many frames each."""
        firsts = range(0, self.frames, size)
        return [
            Chunk(self.recording, first, min(size, self.frames - first), key)
            for first, key in zip(firsts, self.keys, strict=True)
        ]


@dataclass(frozen=True)
class Plan:
    """All work on the recordings below a root.

    Attributes:
        root: of the recordings.
        recordings: those that can be opened.
        failures: the others, and what failed later.
    """

    root: str
    recordings: list[PlannedRecording] = field(default_factory=list)
    failures: list[Failure] = field(default_factory=list)

    @classmethod
    def make(
        cls, root: Path, found: Found, settings: FleetSettings, progress: Progress | None = None
    ) -> "Plan":
        """Open each recording and cut it into chunks; one that cannot be opened is a failure."""
        plan = cls(str(root.resolve()))
        for path, refused in found.refused.items():
            plan.failures.append(Failure(path, None, None, refused.code, str(refused)))
        for done, recording in enumerate(found.recordings, start=1):
            try:
                dataset = recording.recording.open(settings.fusion.source)
                content = digest_input(recording, dataset)
            except FusionSlamError as error:
                named = Failure(recording.session, None, None, error.code, str(error))
                plan.failures.append(named)
            else:
                chunks = cut_recording(recording, len(dataset), content, settings)
                keys = tuple(chunk.key for chunk in chunks)
                plan.recordings.append(PlannedRecording(recording, len(dataset), keys))
            if progress is not None:
                progress(done, len(found.recordings))
        return plan

    @classmethod
    def load(cls, folder: Path) -> "Plan":
        """Read the plan of a folder and its failures. Raises DataError if it is damaged."""
        with load_json(folder / PLAN, PLAN_FORMAT, "the recordings of a fleet") as values:
            recordings = [
                PlannedRecording(
                    FleetRecording.load(each["recording"]), int(each["frames"]), tuple(each["keys"])
                )
                for each in values["recordings"]
            ]
            return cls(str(values["root"]), recordings, load_failures(folder))

    def save(self, folder: Path) -> None:
        """Write the plan. Raises DataError if it cannot be written."""
        recordings = [
            {"recording": e.recording.dump(), "frames": e.frames, "keys": list(e.keys)}
            for e in self.recordings
        ]
        save_json(folder / PLAN, PLAN_FORMAT, {"root": self.root, "recordings": recordings})

    def joined(self, earlier: "Plan") -> tuple["Plan", list[PlannedRecording]]:
        """Return this plan with the recordings of an earlier one, and those that have changed.

        Recordings that are not found any more stay: robots make room for new ones. One of another
        path with the name of an earlier one is refused.
        """
        known = {each.recording.session: each for each in earlier.recordings}
        plan, changed = Plan(self.root, failures=[*self.failures]), []
        for new in self.recordings:
            old = known.get(new.recording.session, new)
            if old.recording.recording.path != new.recording.recording.path:
                plan.failures.append(_same_name(new, old))
                continue
            known[new.recording.session] = new
            if old.keys != new.keys:
                changed.append(old)
        plan.recordings.extend(known[session] for session in sorted(known))
        return plan, changed

    @property
    def frames(self) -> int:
        """Number of frames of all recordings."""
        return sum(each.frames for each in self.recordings)


def _same_name(new: PlannedRecording, old: PlannedRecording) -> Failure:
    session, path = new.recording.session, old.recording.recording.path
    reason = f"{new.recording.recording.path} has the name of {path}, which is known already"
    return Failure(session, None, None, "same-name", reason)


def load_failures(folder: Path) -> list[Failure]:
    """Return what failed when a folder was worked on last."""
    path = folder / FAILED
    if not path.exists():
        return []
    lines = path.read_text(encoding="utf-8").splitlines()
    return [Failure(**json.loads(line)) for line in lines]


def save_failures(folder: Path, failures: Sequence[Failure]) -> None:
    """Write ``failed.jsonl``, a line for each failure. Raises DataError if it cannot be."""
    lines = [json.dumps(each.dump(), ensure_ascii=False) for each in failures]
    with atomic_path(folder / FAILED) as temporary:
        temporary.write_text("".join(f"{line}\n" for line in lines), encoding="utf-8")


def describe_recordings(
    plan: Plan,
    settings: FleetSettings,
    folder: Path,
    engine: Engine,
    *,
    progress: Progress | None = None,
    take: Callable[[Chunk], None] | None = None,
) -> list[Failure]:
    """Describe what is missing; return all failures, which are in ``failed.jsonl``, too.

    Args:
        plan: all work.
        settings: of the folder.
        folder: of the results.
        engine: runs the work.
        progress: called with (frames done, total).
        take: called with each chunk whose file is there, in this process.
    """
    size, total, done = settings.fleet.chunk, plan.frames, 0
    failures = [*plan.failures]
    save_failures(folder, failures)
    missing: list[Chunk] = []
    report = progress or (lambda done, total: None)
    for chunk in (chunk for each in plan.recordings for chunk in each.chunks(size)):
        if not chunk.path(folder).exists():
            missing.append(chunk)
            continue
        done += chunk.count
        if take is not None:
            take(chunk)
    report(done, total)
    for chunk, failure in _work_off(missing, settings, folder, engine):
        done += chunk.count
        if failure is not None:
            failures.append(failure)
            save_failures(folder, failures)
        elif take is not None:
            take(chunk)
        report(done, total)
    return failures


def _work_off(
    chunks: Sequence[Chunk], settings: FleetSettings, folder: Path, engine: Engine
) -> Iterator[tuple[Chunk, Failure | None]]:
    """Work on chunks; those that fail are tried again alone, after all others."""
    work = partial(describe_chunk, settings=settings, folder=folder)
    again: list[tuple[Chunk, BaseException]] = []
    for chunk, error in engine.run(chunks, work):
        if error is None:
            yield chunk, None
        else:
            again.append((chunk, error))
    given_up: dict[str, Failure] = {}
    for chunk, first_error in again:
        session = chunk.recording.session
        if session in given_up:
            code, reason = (
                "given-up",
                f"given up, as another part failed: {given_up[session].reason}",
            )
            yield chunk, Failure(session, chunk.first, chunk.count, code, reason)
            continue
        error, tries = _try_again(chunk, first_error, work, engine, settings.fleet.tries)
        if error is None:
            yield chunk, None
            continue
        code, reason = explain_failure(error)
        given_up[session] = Failure(session, chunk.first, chunk.count, code, reason, tries)
        yield chunk, given_up[session]


def _try_again(
    chunk: Chunk,
    error: BaseException,
    work: Callable[[Chunk], None],
    engine: Engine,
    most: int,
) -> tuple[BaseException | None, int]:
    """Try a chunk alone until it succeeds or its tries are used up; return the last error."""
    last: BaseException | None = error
    tries = 1
    while last is not None and tries < most:
        ((_, last),) = engine.run([chunk], work, alone=True)
        tries += 1
    return last, tries


@dataclass(frozen=True)
class Status:
    """How far the work on a recording is."""

    recording: FleetRecording
    frames: int
    done: int
    failed: int


def list_status(folder: Path) -> tuple[list[Status], list[Failure]]:
    """Return how far the work on each recording is, and what failed.

    Raises:
        DataError: the folder is none of ``fleet describe``, or damaged.
    """
    if not (folder / PLAN).exists():
        FleetSettings.load(folder)  # says what is wrong
        raise DataError(
            f"{folder}: the recordings are not listed yet: fleet describe was stopped before",
            code="missing-file",
            fields=(str(folder / PLAN),),
        )
    settings, plan = FleetSettings.load(folder), Plan.load(folder)
    failed: Mapping[str, int] = _count_failed(plan.failures)
    found = []
    for each in plan.recordings:
        chunks = each.chunks(settings.fleet.chunk)
        done = sum(chunk.count for chunk in chunks if chunk_path(folder, chunk.key).exists())
        session = each.recording.session
        found.append(Status(each.recording, each.frames, done, failed.get(session, 0)))
    return found, plan.failures


def _count_failed(failures: Sequence[Failure]) -> dict[str, int]:
    count: dict[str, int] = defaultdict(int)
    for each in failures:
        count[each.session] += each.count or 0
    return count
