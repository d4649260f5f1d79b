# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Scans that are looked for among the places of a fleet: files of clouds, frames of recordings."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TypeVar

from fusionslam.base.arrays import Matrix
from fusionslam.base.csv_files import write_csv
from fusionslam.base.progress import Step, label_progress
from fusionslam.datasets import read_cloud
from fusionslam.datasets.cloud_files import CLOUD_SUFFIXES
from fusionslam.errors import ConfigError, FusionSlamError
from fusionslam.fleet.localization import FleetLocalization, FleetLocator
from fusionslam.fleet.places import PlaceFilter
from fusionslam.pipelines.place_maps import POSE_NAMES, pose_texts
from fusionslam.pipelines.recording import Recording
from fusionslam.sensors.frame import Cloud, Frame

T = TypeVar("T")

_PLACE = ("distance", "site", "region", "robot", "session", "frame", "stamp_ns")
COLUMNS = (
    *("scan", "scan_frame", "rank", *_PLACE),
    *(f"place_{name}" for name in POSE_NAMES),
    *(f"from_place_{name}" for name in POSE_NAMES),
    *POSE_NAMES,
    *("probability", "reason"),
)
"""Of the table of ``write_candidates``."""


@dataclass(frozen=True)
class Scan:
    """A scan that is looked for.

    Attributes:
        path: of the cloud, or of the recording, as it was named.
        frame: number in the recording; None for a cloud.
        read: returns the scan. Raises FusionSlamError: it cannot be read.
    """

    path: Path
    frame: int | None
    read: Callable[[], Frame | Cloud]

    def __str__(self) -> str:
        return self._name(self.path)

    @property
    def short_name(self) -> str:
        """The end of the path, and the frame, as tables have little room."""
        return self._name(Path(*self.path.parts[-2:]))

    def _name(self, path: Path) -> str:
        return str(path) if self.frame is None else f"{path}, frame {self.frame}"


def list_scans(paths: Sequence[Path], frames: Sequence[int], source: str) -> list[Scan]:
    """Return the scans at some paths.

    Args:
        paths: clouds (.ply, .pcd, .bin) and recordings. One that cannot be opened is a scan that
            cannot be read.
        frames: numbers of frames of all recordings; empty for all of them.
        source: of the recordings' clouds.

    Raises:
        ConfigError: a recording has no frame of a number, or a number is given for a cloud
            (code "choice").
    """
    return [scan for path in paths for scan in _scans_at(path, frames, source)]


def _scans_at(path: Path, frames: Sequence[int], source: str) -> Iterator[Scan]:
    if path.suffix.lower() in CLOUD_SUFFIXES:
        if frames:
            raise _no_frame(frames[0], f"{path} is a cloud, expected a recording")
        yield Scan(path, None, partial(read_cloud, path))
        return
    try:
        dataset = Recording.at(path).open(source)
    except FusionSlamError as error:
        yield Scan(path, None, partial(_raise, error))
        return
    numbers = dataset.numbers.tolist()
    rows = {number: row for row, number in enumerate(numbers)}
    for frame in frames or numbers:
        if frame not in rows:
            raise _no_frame(frame, f"{dataset.name} has frames {numbers[0]} to {numbers[-1]}")
        yield Scan(path, frame, partial(dataset.__getitem__, rows[frame]))


def _no_frame(frame: int, why: str) -> ConfigError:
    return ConfigError(f"--frame {frame}: {why}", code="choice", fields=("--frame", str(frame)))


def _raise(error: FusionSlamError) -> Frame:
    raise error


def localize_scans(
    locator: FleetLocator,
    scans: Sequence[Scan],
    k: int = 10,
    where: PlaceFilter | None = None,
    *,
    proves: bool = True,
    step: Step | None = None,
) -> list[FleetLocalization | FusionSlamError]:
    """Look for scans among places: describe one after the other, and search for all at once.

    Args:
        locator: of the places.
        scans: that are looked for.
        k, where: as of ``FleetLocator.find``.
        proves: whether candidates are proven by registration; else results have no reason, either.
        step: progress callback.

    Returns:
        For each scan what was found, or why it cannot be read or described.
    """
    if proves:
        queries, refused = _describe(scans, lambda seen: locator.query_of(seen).packed(), step)
        show = label_progress(step, "proving poses")
        found = locator.localize_all(queries, k, where, progress=show)
    else:
        vectors, refused = _describe(scans, locator.describe, step)
        found = [FleetLocalization(each) for each in locator.find_all(vectors, k, where)]
    rest = iter(found)
    return [refused[row] if row in refused else next(rest) for row in range(len(scans))]


def _describe(
    scans: Sequence[Scan], describe: Callable[[Frame | Cloud], T], step: Step | None
) -> tuple[list[T], dict[int, FusionSlamError]]:
    """Describe what can be read and described; and say why the others cannot be, by their rows."""
    progress = label_progress(step, "describing scans")
    described: list[T] = []
    refused: dict[int, FusionSlamError] = {}
    for row, scan in enumerate(scans):
        try:
            described.append(describe(scan.read()))
        except FusionSlamError as error:
            refused[row] = error
        progress(row + 1, len(scans))
    return described, refused


def write_candidates(
    path: Path, scans: Sequence[Scan], found: Sequence[FleetLocalization | FusionSlamError]
) -> None:
    """Write a CSV with the candidates of all scans (``COLUMNS``), the nearest first.

    Columns place_x to place_qw are the pose of the candidate's robot in the frame of its recording,
    from_place_x to from_place_qw that of the scan's robot in the frame of the candidate's, x to qw
    the same in the frame of the recording (metres, quaternion); the last two are those of the one
    candidate that proves a pose. Without a proof reason is the code of why there is none. A scan
    without candidates, or that failed, has one line.

    Args:
        path: of the file.
        scans, found: of ``localize_scans``.

    Raises:
        DataError: the file cannot be written.
    """
    rows = (row for pair in zip(scans, found, strict=True) for row in _rows(*pair))
    write_csv(path, COLUMNS, rows)


def _rows(scan: Scan, found: FleetLocalization | FusionSlamError) -> Iterator[list[object]]:
    about = [scan.path, "" if scan.frame is None else scan.frame]
    empty = [""] * len(COLUMNS)
    if isinstance(found, FusionSlamError):
        yield [*about, *empty[3:], found.code]
        return
    reason = "" if found.reason is None else found.reason.code
    if not found.candidates:
        yield [*about, *empty[3:], reason]
    for rank, each in enumerate(found.candidates, start=1):
        proven = each is found.place
        yield [
            *about,
            rank,
            *(getattr(each, name) for name in _PLACE),
            *_texts(each.pose),
            *_texts(found.place_from_robot if proven else None),
            *_texts(found.site_from_robot if proven else None),
            f"{found.probability:.4f}" if proven else "",
            reason,
        ]


def _texts(pose: Matrix | None) -> list[str]:
    return [""] * len(POSE_NAMES) if pose is None else pose_texts(pose)
