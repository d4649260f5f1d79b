# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The joint map of all drives at a site, which grows as drives arrive."""

import hashlib
import json
import logging
import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

from fusionslam.base.archive import load_json, save_json
from fusionslam.base.files import atomic_path, scratch_folder
from fusionslam.base.progress import Step, label_progress
from fusionslam.errors import ConfigError, DataError, FusionSlamError
from fusionslam.fleet.config import FleetSettings
from fusionslam.fleet.recordings import FleetRecording
from fusionslam.fleet.work import PlannedRecording
from fusionslam.mapping import PlaceMap
from fusionslam.mapping.config import MapConfig
from fusionslam.pipelines.place_maps import MapOdometry, build_map, check_odometry, odometry_of

logger = logging.getLogger(__name__)

MAPS = "maps"
_RECORD_FORMAT = "fusionslam.fleet_site.1"
_LONGEST = 40
"""Characters of a name that are kept in that of a file, which has at most 255 bytes."""
_BEGINNINGS = 10
"""Drives with which a joint map may begin; each is compared with all others."""


@dataclass
class SiteMerge:
    """What became of the drives at a site.

    Attributes:
        path: of the joint map.
        known: sessions that it had already.
        added: sessions that it took in now.
        left_out: reasons by session that it could not take in, yet.
    """

    path: Path
    known: list[str] = field(default_factory=list)
    added: list[str] = field(default_factory=list)
    left_out: dict[str, str] = field(default_factory=dict)


@dataclass
class SiteRecord:
    """Which state of each recording is in the maps of a site, and which drives were refused.

    Attributes:
        path: of the file, beside the joint map.
        contents: names of what the recordings hold now, by session; "" where that is unknown.
        settings: all else that maps and loops between them depend on.
        begun: contents of which the maps of single drives were begun.
        built: states, with settings, of which they were completed.
        joined: contents that are in the joint map.
        refused: by the first session of a joint map and the session that does not join it: the
            state of both, and why.
    """

    path: Path
    contents: Mapping[str, str]
    settings: str
    begun: dict[str, str] = field(default_factory=dict)
    built: dict[str, str] = field(default_factory=dict)
    joined: dict[str, str] = field(default_factory=dict)
    refused: dict[str, dict[str, tuple[str, str]]] = field(default_factory=dict)

    @classmethod
    def load(cls, path: Path, contents: Mapping[str, str], settings: str = "") -> "SiteRecord":
        """Read the record of a site; an empty one if there is none.

        Raises:
            DataError: the file is damaged.
        """
        record = cls(path, contents, settings)
        if path.exists():
            with load_json(path, _RECORD_FORMAT, "what is known of a site's drives") as values:
                for name in ("begun", "built", "joined"):
                    getattr(record, name).update(values[name])
                for first, reasons in values["refused"].items():
                    pairs = {name: (str(state), str(why)) for name, (state, why) in reasons.items()}
                    record.refused[first] = pairs
        return record

    def save(self) -> None:
        """Write the record. Raises DataError if it cannot be written."""
        self.path.parent.mkdir(parents=True, exist_ok=True)
        names = ("begun", "built", "joined", "refused")
        save_json(self.path, _RECORD_FORMAT, {name: getattr(self, name) for name in names})

    def has_changed(self, session: str, seen: dict[str, str]) -> bool:
        """Whether a recording holds something else than was seen of it.

        One that was not seen before is taken to be the same.

        Args:
            session: of the recording.
            seen: ``begun`` or ``joined``.
        """
        now = self.contents[session]
        if not seen.get(session):
            seen[session] = now
        return bool(now) and now != seen[session]

    def is_built(self, session: str) -> bool:
        """Whether the map of a drive was completed, of what the recording holds now."""
        return self.built.get(session) == self._digest([self.contents[session]])

    def note_built(self, session: str) -> None:
        """Remember that the map of a drive is complete."""
        self.built[session] = self._digest([self.contents[session]])
        self.save()

    def refusal(self, joint: Sequence[str], session: str) -> str | None:
        """Return why a drive did not join these sessions as they are now; None if it may."""
        state, reason = self.refused.get(joint[0], {}).get(session, ("", ""))
        return reason if state == self._state_of([*sorted(joint), session]) else None

    def note_refusal(self, joint: Sequence[str], session: str, reason: str) -> None:
        """Remember why a drive does not join the sessions of a joint map."""
        state = self._state_of([*sorted(joint), session])
        self.refused.setdefault(joint[0], {})[session] = state, reason
        self.save()

    def forget(self, session: str) -> None:
        """Delete all that is known of a drive."""
        for states in (self.begun, self.built, self.joined):
            states.pop(session, None)
        self.refused.pop(session, None)
        for reasons in self.refused.values():
            reasons.pop(session, None)

    def _state_of(self, sessions: Sequence[str]) -> str:
        return self._digest(
            [[each, self.joined.get(each, self.contents.get(each, ""))] for each in sessions]
        )

    def _digest(self, held: Sequence[object]) -> str:
        return hashlib.sha256(json.dumps([held, self.settings]).encode()).hexdigest()[:32]


def site_map_path(folder: Path, site: str) -> Path:
    """Return the file of a site's joint map."""
    return folder / MAPS / f"{_file_name(site)}.fsmap"


def _drive_map_path(folder: Path, drive: FleetRecording) -> Path:
    joint = site_map_path(folder, drive.site)
    return joint.with_suffix("") / f"{_file_name(drive.session)}.fsmap"


def forget_drive(folder: Path, drive: FleetRecording) -> None:
    """Delete the map of a drive, and its session of the site's joint map.

    Raises:
        DataError: a map cannot be written.
        FusionSlamError: there is a joint map, and the extra ``map`` is not installed.
    """
    _drive_map_path(folder, drive).unlink(missing_ok=True)
    path = site_map_path(folder, drive.site)
    _leave(path, drive.session)
    if (file := _record_path(path)).exists():
        try:
            record = SiteRecord.load(file, {})
        except DataError as error:  # it only saves work
            logger.warning("%s; it is deleted", error)
            file.unlink()
        else:
            record.forget(drive.session)
            record.save()


def _record_path(joint: Path) -> Path:
    return joint.with_suffix("") / "joined.json"


def _leave(path: Path, session: str) -> None:
    """Delete a session of a joint map, if it has it."""
    if session in _sessions(path):
        with PlaceMap.open(path) as site:
            site.forget(session)


def merge_site(
    folder: Path,
    site: str,
    recordings: Sequence[PlannedRecording],
    settings: FleetSettings,
    *,
    odometry: MapOdometry = "recorded",
    mapping: MapConfig | None = None,
    jobs: int = 1,
    step: Step | None = None,
) -> SiteMerge:
    """Build the map of each drive at a site, and join them.

    What is done already is not done again. A drive that no three loops join with the others waits
    for those that come later; it is compared again once the joint map or its own has changed. A
    drive whose recording has changed leaves the joint map, and is built and joined anew.

    Args:
        folder: of ``fleet describe``.
        site: name of the site.
        recordings: all of the fleet; those of the site count.
        settings: of the folder.
        odometry: where the motion of the drives is from.
        mapping: of new maps.
        jobs: number of frames read ahead.
        step: progress callback.

    Raises:
        ConfigError: no recording is of this site (code "unknown-site").
        DataError: a map cannot be written; what was joined stays.
    """
    drives = [each for each in recordings if each.recording.site == site]
    if not drives:
        known = sorted({each.recording.site for each in recordings})
        raise ConfigError(
            f"no recording is of the site {site!r}: expected one of {', '.join(map(repr, known))}",
            code="unknown-site",
            fields=("site", site),
        )
    mapping = mapping or MapConfig()
    merge = SiteMerge(site_map_path(folder, site))
    merge.known = _sessions(merge.path)
    record = SiteRecord.load(
        _record_path(merge.path),
        {each.recording.session: each.content for each in drives},
        json.dumps([settings.digest, mapping.model_dump(mode="json"), odometry]),
    )
    record.joined = {name: record.joined.get(name, "") for name in merge.known}
    build = partial(
        _build, settings=settings, odometry=odometry, mapping=mapping, jobs=jobs, step=step
    )
    built: dict[str, Path] = {}
    for drive in (each.recording for each in drives):
        session, path = drive.session, _drive_map_path(folder, drive)
        if session in merge.known and not record.has_changed(session, record.joined):
            continue
        try:
            _build_current(path, drive, record, build)
            if session in merge.known:
                _leave(merge.path, session)
        except FusionSlamError as error:
            merge.left_out[session] = str(error)
        else:
            merge.known = [each for each in merge.known if each != session]
            built[session] = path
    # Before they are joined: if this is killed, what has changed meanwhile is noticed.
    record.joined |= {session: record.contents[session] for session in built}
    record.save()
    if len(merge.known) > 1:
        _grow(merge, merge.path, merge.known, built, record, step)
    elif built:
        _begin(merge, built, record, step)
    return merge


def _build_current(
    path: Path, drive: FleetRecording, record: SiteRecord, build: Callable[..., None]
) -> None:
    """Build the map of a drive unless it is complete; of a recording that has changed, anew."""
    session = drive.session
    is_other = session in record.built and not record.is_built(session)
    if record.has_changed(session, record.begun) or is_other:
        path.unlink(missing_ok=True)
        record.built.pop(session, None)
        record.begun[session] = record.contents[session]
    if path.exists() and record.is_built(session):
        return
    record.save()
    build(path, drive)
    record.note_built(session)


def _sessions(path: Path) -> list[str]:
    """Return the sessions of a map; none if there is no map."""
    if not path.exists():
        return []
    with PlaceMap.open(path, read_only=True) as site:
        return [each.name for each in site.sessions]


def _build(
    path: Path,
    drive: FleetRecording,
    *,
    settings: FleetSettings,
    odometry: MapOdometry,
    mapping: MapConfig,
    jobs: int,
    step: Step | None,
) -> None:
    """Build the map of one drive, or go on with it."""
    dataset = drive.recording.open(settings.fusion.source)
    check_odometry(dataset, odometry)
    moved = odometry_of(dataset, odometry, jobs=jobs, step=step)
    path.parent.mkdir(parents=True, exist_ok=True)
    with PlaceMap.open(
        path,
        drive.session,
        descriptor=settings.names[0],
        describe=settings.descriptors,
        fusion=settings.fusion,
        registration=settings.registration,
        config=mapping,
    ) as site:
        progress = label_progress(step, f"mapping {drive.session}")
        done = build_map(site, dataset, moved, bad_frames="skip", jobs=jobs, progress=progress)
        if not len(site):
            why = next(iter(done.skipped.values()), "it has no frame")
            raise DataError(f"no frame can be mapped: {why}", code="empty", fields=(drive.session,))


def _begin(
    merge: SiteMerge, built: Mapping[str, Path], record: SiteRecord, step: Step | None
) -> None:
    """Begin a joint map with a drive that another one joins, if there is one of such.

    Else it holds the first drive alone, and may begin anew when others come.
    """
    alone = {session: merge.path for session in merge.known}
    drives = {**alone, **built}
    for first in [*drives][:_BEGINNINGS]:
        others = {session: path for session, path in drives.items() if session != first}
        trial = SiteMerge(merge.path, left_out={**merge.left_out})
        with scratch_folder(merge.path) as folder:
            joint = folder / merge.path.name
            if any(record.refusal([first], session) is None for session in others):
                _copy(drives[first], joint)
            _grow(trial, joint, [first], others, record, step)
            if trial.added or first == next(iter(drives)):
                reasons = trial.left_out
            if trial.added:
                _copy(joint, merge.path)
                merge.added = [each for each in (first, *trial.added) if each not in alone]
                break
    else:
        if not alone:
            first = next(iter(drives))
            _copy(drives[first], merge.path)
            merge.added = [first]
    merge.left_out = reasons


def _grow(
    merge: SiteMerge,
    joint: Path,
    known: Sequence[str],
    others: Mapping[str, Path],
    record: SiteRecord,
    step: Step | None,
) -> None:
    """Take maps into one, again and again, as one that is taken in may be joined by others.

    Those that were refused before by the same sessions are not compared again.
    """
    sessions, waiting, grew = [*known], dict(others), True
    while waiting and grew:
        grew = False
        for session, path in [*waiting.items()]:
            reason = record.refusal(sessions, session)
            if reason is None:
                reason = _join(joint, path, session, sessions, record, step)
            if reason is not None:
                merge.left_out[session] = reason
                continue
            merge.added.append(session)
            merge.left_out.pop(session, None)
            sessions.append(session)
            del waiting[session]
            grew = True


def _join(
    path: Path,
    other: Path,
    session: str,
    known: Sequence[str],
    record: SiteRecord,
    step: Step | None,
) -> str | None:
    """Take a map into the joint one; return why not, or None."""
    try:
        with PlaceMap.open(path) as site:
            done = site.merge(other, progress=label_progress(step, f"joining {session}"))
    except FusionSlamError as error:
        if error.code == "cannot-write":
            raise
        return str(error)  # as of another configuration; the others may still be joined
    if done.reason is None:
        return None
    record.note_refusal(known, session, done.reason.text)
    return done.reason.text


def _copy(source: Path, target: Path) -> None:
    """Copy a closed map, whole or not at all."""
    with atomic_path(target) as temporary:
        shutil.copyfile(source, temporary)


def _file_name(name: str) -> str:
    """A name with nothing that a file's name cannot have, and no other name's."""
    kept = "".join(each if each.isalnum() or each in "-_." else "_" for each in name).lstrip(".")
    if kept and kept == name and len(name) <= _LONGEST:
        return kept
    return f"{kept[:_LONGEST]}-{hashlib.sha256(name.encode()).hexdigest()[:8]}"
