# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Describes all recordings of a fleet, by many workers, and goes on where it stopped."""

import json
import logging
from collections import Counter, deque
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, Protocol

from fusionslam.base.archive import load_json, save_json
from fusionslam.base.files import write_file
from fusionslam.base.parallel import ordered_results
from fusionslam.base.progress import Progress
from fusionslam.errors import DataError, FusionSlamError
from fusionslam.fleet.chunk import (
    Chunk,
    cut_recording,
    describe_chunk,
    explain_failure,
    is_chunk_key,
    is_stored,
)
from fusionslam.fleet.config import FleetSettings
from fusionslam.fleet.engines import Engine
from fusionslam.fleet.recordings import FleetRecording, Found, digest_input

logger = logging.getLogger(__name__)

PLAN, PLAN_FORMAT = "recordings.json", "fusionslam.fleet_recordings.1"
FAILED = "failed.jsonl"
_BAD_FRAMES = "bad-frames"
"""Code of frames that cannot be described; the others of their chunk are."""
_OPENED_AT_ONCE = 8
"""Recordings; disks and networks are waited for, not the processor."""
_RETRIES = 10
"""Tries again that fail, after which no part of the recording is tried again."""
_UNWRITTEN = 5
"""Chunks in a row that cannot be written, after which none are begun: the disk is full."""


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


@dataclass(frozen=True)
class PlannedRecording:
    """A recording as it was when it was listed.

    Attributes:
        recording: how it is opened.
        frames: number of them.
        keys: of its chunks, in order.
        content: name of its content, as of ``digest_input``.
    """

    recording: FleetRecording
    frames: int
    keys: tuple[str, ...]
    content: str

    @property
    def identity(self) -> tuple[str, str | None]:
        """Where the recording is: its path, and the sequence there."""
        return self.recording.recording.path, self.recording.recording.sequence

    @classmethod
    def load(cls, values: Mapping[str, Any]) -> "PlannedRecording":
        """Return what ``dump`` was called on.

        Raises:
            DataError: a key is not one that we make, such as a path (code "bad-key").
        """
        recording = FleetRecording.load(values["recording"])
        keys, content = tuple(values["keys"]), str(values["content"])
        for key in keys:
            if not is_chunk_key(key):
                raise DataError(
                    f"the chunk {key!r} of {recording.session}: expected 32 hexadecimal digits",
                    code="bad-key",
                    fields=("keys", str(key)),
                )
        return cls(recording, int(values["frames"]), keys, content)

    def chunks(self, size: int) -> list[Chunk]:
        """Return its chunks, of so many frames each.

        Raises:
            DataError: its file lists another number of chunks (code "damaged").
        """
        firsts = range(0, self.frames, size)
        if len(firsts) != len(self.keys):
            raise DataError(
                f"{self.recording.session}: {len(self.keys)} chunks are listed, expected "
                f"{len(firsts)} of {size} frames for {self.frames}",
                code="damaged",
                fields=(self.recording.session,),
            )
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
        outdated: recordings as they were before they changed, whose places are still there.
    """

    root: str
    recordings: list[PlannedRecording] = field(default_factory=list)
    failures: list[Failure] = field(default_factory=list)
    outdated: list[PlannedRecording] = field(default_factory=list)

    @classmethod
    def make(
        cls, root: Path, found: Found, settings: FleetSettings, progress: Progress | None = None
    ) -> "Plan":
        """Open each recording and cut it into chunks; one that cannot be opened is a failure."""
        plan = cls(str(root.resolve()))
        for path, refused in found.refused.items():
            plan.failures.append(Failure(path, None, None, refused.code, str(refused)))

        def open_one(index: int) -> PlannedRecording | Failure:
            return _plan_recording(found.recordings[index], settings)

        total = len(found.recordings)
        with ordered_results(open_one, range(total), _OPENED_AT_ONCE) as planned:
            for done, each in enumerate(planned, start=1):
                if isinstance(each, Failure):
                    plan.failures.append(each)
                else:
                    plan.recordings.append(each)
                if progress is not None:
                    progress(done, total)
        return plan

    @classmethod
    def load(cls, folder: Path) -> "Plan":
        """Read the plan of a folder and its failures. Raises DataError if it is damaged."""
        with load_json(folder / PLAN, PLAN_FORMAT, "the recordings of a fleet") as values:
            recordings, outdated = (
                [PlannedRecording.load(each) for each in values.get(name, ())]
                for name in ("recordings", "outdated")
            )
            return cls(str(values["root"]), recordings, load_failures(folder), outdated)

    def save(self, folder: Path) -> None:
        """Write the plan. Raises DataError if it cannot be written."""
        recordings, outdated = (
            [asdict(each) for each in some] for some in (self.recordings, self.outdated)
        )
        values = {"root": self.root, "recordings": recordings, "outdated": outdated}
        save_json(folder / PLAN, PLAN_FORMAT, values)

    def joined(self, earlier: "Plan") -> "Plan":
        """Return this plan with the recordings of an earlier one; those that changed are outdated.

        Recordings that are not found any more stay: robots make room for new ones. One of another
        path with the name of an earlier one, which is still there, is refused; and so is one that
        has another name already.
        """
        known = {each.recording.session: each for each in earlier.recordings}
        names = {each.identity: each.recording.session for each in earlier.recordings}
        plan = Plan(self.root, failures=[*self.failures], outdated=[*earlier.outdated])
        for new in self.recordings:
            session = new.recording.session
            old = known.get(session, new)
            path = old.recording.recording.path
            if path != new.recording.recording.path and Path(path).exists():
                here = new.recording.recording.path
                reason = f"{here} has the name of {path}, which is known already"
                plan.failures.append(Failure(session, None, None, "same-name", reason))
                continue
            if (other := names.get(new.identity, session)) != session:
                here = new.recording.recording.path
                reason = f"{here} is known already as {other!r}: expected the same ROOT as then"
                plan.failures.append(Failure(session, None, None, "same-recording", reason))
                continue
            known[session] = new
            if old.keys != new.keys:
                plan.outdated.append(old)
        plan.recordings.extend(known[session] for session in sorted(known))
        return plan

    @property
    def frames(self) -> int:
        """Number of frames of all recordings."""
        return sum(each.frames for each in self.recordings)


def _plan_recording(
    recording: FleetRecording, settings: FleetSettings
) -> PlannedRecording | Failure:
    """Open a recording and cut it into chunks; return why not if it cannot be."""
    try:
        dataset = recording.recording.open(settings.fusion.source)
        content = digest_input(recording, dataset)
    except FusionSlamError as error:
        return Failure(recording.session, None, None, error.code, str(error))
    except Exception as error:  # one damaged file must not keep a fleet from its work
        return Failure(recording.session, None, None, *explain_failure(error))
    chunks = cut_recording(recording, len(dataset), content, settings)
    return PlannedRecording(recording, len(dataset), tuple(each.key for each in chunks), content)


def load_failures(folder: Path) -> list[Failure]:
    """Return what failed when a folder was worked on last; not a line that was not completed."""
    try:
        lines = (folder / FAILED).read_text(encoding="utf-8").splitlines()
    except OSError:
        return []
    failures = []
    for line in lines:
        with suppress(ValueError, TypeError):
            failures.append(Failure(**json.loads(line)))
    return failures


def save_failures(folder: Path, failures: Sequence[Failure]) -> None:
    """Write ``failed.jsonl``, a line for each failure. Raises DataError if it cannot be."""
    write_file(folder / FAILED, "".join(map(_line, failures)))


def add_failure(folder: Path, failure: Failure) -> None:
    """Add a line to ``failed.jsonl``; the log has it if there is no space for it."""
    try:
        with (folder / FAILED).open("a", encoding="utf-8") as file:
            file.write(_line(failure))
    except OSError as error:
        logger.warning("%s: %s; it would say: %s", folder / FAILED, error.strerror, failure.reason)


def _line(failure: Failure) -> str:
    return json.dumps(vars(failure)) + "\n"


class ChunkTaker(Protocol):
    """Takes in chunks that are there, as a database does."""

    def take(self, chunk: Chunk) -> Mapping[int, str] | None:
        """Take in a chunk.

        Returns:
            Reasons by number of the frames that could not be described; None if it was taken in
            by an earlier run.

        Raises:
            DataError: its file is damaged.
        """


def describe_recordings(
    plan: Plan,
    settings: FleetSettings,
    folder: Path,
    engine: Engine,
    *,
    progress: Progress | None = None,
    taker: ChunkTaker | None = None,
) -> list[Failure]:
    """Describe what is missing; return all failures, which are in ``failed.jsonl``, too.

    Args:
        plan: all work.
        settings: of the folder.
        folder: of the results.
        engine: runs the work.
        progress: called with (frames done, total); those that failed are done, too.
        taker: is given each chunk whose file is there, in this process.
    """
    total, done = plan.frames, 0
    failures = [*plan.failures]
    bad = (each for each in load_failures(folder) if each.code == _BAD_FRAMES)
    noted = {(each.session, each.first): each for each in bad}
    missing: list[Chunk] = []
    report = progress or (lambda done, total: None)
    for chunk in (chunk for each in plan.recordings for chunk in each.chunks(settings.fleet.chunk)):
        taken = _take(taker, chunk, folder) if is_stored(chunk.path(folder)) else _Taken(False)
        if not taken.is_there:
            missing.append(chunk)
            continue
        known = noted.get((chunk.recording.session, chunk.first)) if taken.is_known else None
        failures += [each for each in (taken.failure, known) if each is not None]
        done += chunk.count
        report(done, total)
    save_failures(folder, failures)
    report(done, total)
    for chunk, failed in _work_off(missing, settings, folder, engine):
        failure = failed or _take(taker, chunk, folder).failure
        if failure is not None:
            failures.append(failure)
            add_failure(folder, failure)
        done += chunk.count
        report(done, total)
    return failures


class _Taken(NamedTuple):
    """What became of a chunk that was to be taken in.

    Attributes:
        is_there: whether its file is whole.
        failure: what is wrong with it, or with some of its frames.
        is_known: whether an earlier run has taken it in, and noted its bad frames.
    """

    is_there: bool
    failure: Failure | None = None
    is_known: bool = False


def _take(taker: ChunkTaker | None, chunk: Chunk, folder: Path) -> _Taken:
    """Have a chunk taken in; if it is damaged, delete it, as it can be made anew."""
    if taker is None:
        return _Taken(True)
    try:
        skipped = taker.take(chunk)
    except DataError as error:
        logger.warning("%s; it is made anew", error)
        chunk.path(folder).unlink(missing_ok=True)
        return _Taken(False, _failure(chunk, error, 1))
    if not skipped:
        return _Taken(True, is_known=skipped is None)
    number, reason = next(iter(skipped.items()))
    text = (
        f"{len(skipped)} of {chunk.count} frames cannot be described, as frame {number}: {reason}"
    )
    bad = Failure(chunk.recording.session, chunk.first, len(skipped), _BAD_FRAMES, text)
    return _Taken(True, bad)


def _work_off(
    chunks: Sequence[Chunk], settings: FleetSettings, folder: Path, engine: Engine
) -> Iterator[tuple[Chunk, Failure | None]]:
    """Work on chunks; those that fail are tried again, after all others.

    A recording of which many tries fail is not tried on for ever, and none are begun once it is
    plain that nothing can be written.
    """
    work = partial(describe_chunk, settings=settings, folder=folder)
    waiting = deque(chunks)
    failed: dict[str, tuple[Chunk, Failure]] = {}
    spent: Counter[str] = Counter()
    unwritten = 0

    def begin() -> Iterator[Chunk]:
        while waiting and unwritten < _UNWRITTEN:
            chunk = waiting.popleft()
            if spent[chunk.recording.session] < _RETRIES:
                yield chunk

    for attempt in range(1, settings.fleet.tries + 1):
        for chunk, error in engine.run(begin(), work):
            if error is None:
                unwritten = 0
                failed.pop(chunk.key, None)
                yield chunk, None
                continue
            failure = _failure(chunk, error, attempt)
            failed[chunk.key] = chunk, failure
            unwritten = unwritten + 1 if failure.code == "cannot-write" else 0
            spent[chunk.recording.session] += attempt > 1
        if waiting or not failed:
            break
        waiting.extend(chunk for chunk, _ in failed.values())
    yield from failed.values()
    for chunk in waiting:
        if chunk.key not in failed:
            reason = f"not tried, as others could not be written: {failure.reason}"
            yield chunk, _failure(chunk, DataError(reason, code=failure.code), 0)


def _failure(chunk: Chunk, error: BaseException, tries: int) -> Failure:
    code, reason = explain_failure(error)
    return Failure(chunk.recording.session, chunk.first, chunk.count, code, reason, tries)


@dataclass(frozen=True)
class Status:
    """How far the work on a recording is: numbers of all frames, of those done, and failed."""

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
    failed: Counter[str] = Counter()
    bad: Counter[str] = Counter()
    for failure in plan.failures:
        failed[failure.session] += failure.count or 0
        bad[failure.session] += (failure.count or 0) if failure.code == _BAD_FRAMES else 0
    found = []
    for each in plan.recordings:
        chunks, session = each.chunks(settings.fleet.chunk), each.recording.session
        stored = sum(chunk.count for chunk in chunks if is_stored(chunk.path(folder)))
        found.append(Status(each.recording, each.frames, stored - bad[session], failed[session]))
    return found, plan.failures
