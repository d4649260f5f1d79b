# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Preview images of a drive: made from its data, stored beside the runs, read back later."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fusionslam.base.archive import load_archive, save_archive
from fusionslam.evaluation import ViewReport, ViewRun
from fusionslam.report.page.images import forgive
from fusionslam.report.views.thumbnails import Scale, cloud_preview, image_preview, scale_of

FORMAT = "fusionslam.previews.1"
MOST = 600
"""Largest number of scans of a run that the page can show."""
_SAMPLE = 40


def stamp_key(stamp: float) -> int:
    """Key of a preview, in nanoseconds: runs over one drive share previews by time stamp."""
    return round(stamp * 1e9)


def select_rows(report: ViewReport) -> list[int]:
    """Return the rows that the page can show: all, or ``MOST`` of a long run.

    These are the false positives, of more than ``MOST / 2`` those farthest from their view, and
    rows at even steps.
    """
    if report.n <= MOST:
        return list(range(report.n))
    wrong = report.false_positive_indices
    farthest = np.argsort(-report.distances[wrong], kind="stable")[: MOST // 2]
    step = -(-report.n // (MOST - farthest.size))
    return sorted({*range(0, report.n, step), *wrong[farthest].tolist()})


def counterparts(run: ViewRun, report: ViewReport) -> NDArray[np.int64]:
    """Int64 (n,): the first scene of each positive's view; for a false negative the nearest stored
    scene, which it should have matched; -1 for the rest."""
    found = report.matched.copy()
    stored = np.flatnonzero((report.matched < 0) & (report.ids >= 0))
    for row in report.false_negative_indices.tolist():
        earlier = stored[stored < row]
        apart = run.poses[earlier] - run.poses[row]
        turned = np.abs(np.degrees(np.angle(np.exp(1j * apart[:, 2]))))
        metres = np.hypot(apart[:, 0], apart[:, 1])
        turned_away = turned > report.rule.false_negative_angle
        found[row] = earlier[np.argmin(np.where(turned_away, np.inf, metres))]
    return found


def list_needed_rows(run: ViewRun, report: ViewReport) -> list[int]:
    """Return the rows that are shown, and those shown beside them."""
    rows = select_rows(report)
    beside = counterparts(run, report)[rows]
    return sorted({*rows, *beside[beside >= 0].tolist()})


def previews_of(
    judged: Sequence[tuple[ViewRun, ViewReport]], path: Path, missed: dict[str, None]
) -> dict[int, bytes]:
    """Return all previews of one drive's runs, JPEG by ``stamp_key``.

    New previews from the runs' images, or else their clouds, take precedence over stored ones.

    Args:
        judged: what the page shows.
        path: file of stored previews; new ones are added.
        missed: collects the reasons why scans have no picture.
    """
    stored = load_previews(path) if path.exists() else {}
    new: dict[int, bytes] = {}
    for run, report in judged:
        rows = list_needed_rows(run, report)
        rows = [row for row in rows if stamp_key(run.stamps[row]) not in new]
        read_image, read_cloud = forgive(run.images, missed), forgive(run.clouds, missed)
        scale: Scale | None = None
        for row in rows:
            key, number = stamp_key(run.stamps[row]), int(run.numbers[row])
            if (image := read_image(number)) is not None:
                new[key] = image_preview(image)
            elif (cloud := read_cloud(number)) is not None:
                scale = scale or _choose_scale(run, rows)
                new[key] = cloud_preview(cloud, scale)
    if new:
        save_previews(path, stored | new)
    return stored | new


def _choose_scale(run: ViewRun, rows: list[int]) -> Scale:
    """Return a scale that suits a sample of the clouds."""
    read_cloud = forgive(run.clouds, {})
    sample = rows[:: -(-len(rows) // _SAMPLE)]
    clouds = (read_cloud(int(run.numbers[row])) for row in sample)
    return scale_of(cloud for cloud in clouds if cloud is not None)


def save_previews(path: Path, previews: dict[int, bytes]) -> None:
    """Write one .npz, whole or not at all."""
    keys = sorted(previews)
    sizes = [len(previews[key]) for key in keys]
    arrays = {
        "stamps_ns": np.array(keys, dtype=np.int64),
        "offsets": np.append(0, np.cumsum(sizes)).astype(np.int64),
        "jpegs": np.frombuffer(b"".join(previews[key] for key in keys), dtype=np.uint8),
    }
    save_archive(path, FORMAT, {}, arrays)


def load_previews(path: Path) -> dict[int, bytes]:
    """Read what ``save_previews`` wrote. Raises DataError that names the file."""
    with load_archive(path, FORMAT, "stored previews") as (_, stored):
        data, ends = stored["jpegs"].tobytes(), stored["offsets"].tolist()
        keys = stored["stamps_ns"].tolist()
        return {key: data[ends[i] : ends[i + 1]] for i, key in enumerate(keys)}
