# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Which drives of a fleet came by the same places: some places of each, asked for in the others."""

import logging
from dataclasses import dataclass

import numpy as np

from fusionslam.base.progress import Progress
from fusionslam.errors import DataError
from fusionslam.fleet.folder import FleetFolder
from fusionslam.fleet.localization import FleetLocalization
from fusionslam.fleet.place_database import PlaceDatabase
from fusionslam.fleet.places import PlaceFilter, Places, join_places
from fusionslam.fleet.work import Plan

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class Encounter:
    """A place of one drive, and where the others saw it.

    Attributes:
        session: of the drive.
        frame: number of the frame.
        found: the place among those of all other drives.
    """

    session: str
    frame: int
    found: FleetLocalization


def find_encounters(
    folder: FleetFolder,
    database: PlaceDatabase,
    plan: Plan,
    *,
    most: int = 10,
    progress: Progress | None = None,
) -> list[Encounter]:
    """Ask for some places of each drive among those of all others, and prove what is found.

    Args:
        folder: of the places; their clouds are stored.
        database: of the folder.
        plan: of the folder.
        most: places of each drive, spread evenly.
        progress: called with (drives done, total).

    A drive without clouds, or with a damaged chunk, is left out; the log says so.
    """
    locator, found = folder.locator(database), []
    for done, each in enumerate(plan.recordings, start=1):
        session = each.recording.session
        try:
            places = _spread(folder, each.keys, most)
            for row in range(0 if places is None else len(places)):
                assert places is not None
                key, vector = places.keys[row], places.vectors[row]
                seen = locator.localize_place(key, vector, where=PlaceFilter(not_session=session))
                found.append(Encounter(session, int(places.frames[row]), seen))
        except DataError as error:  # no clouds, or a damaged chunk
            logger.warning("%s is not looked for in other drives: %s", session, error)
        if progress is not None:
            progress(done, len(plan.recordings))
    return found


def _spread(folder: FleetFolder, keys: tuple[str, ...], most: int) -> Places | None:
    """Return some places of a drive, of chunks that are spread evenly."""
    there = [key for key in keys if folder.store.has(key)]
    chosen = np.unique(np.linspace(0, len(there) - 1, min(most, len(there))).astype(int))
    store = folder.store
    places = join_places([store.places(there[row]) for row in chosen.tolist()])
    if places is None:
        return None
    rows = np.unique(np.linspace(0, len(places) - 1, min(most, len(places))).astype(int))
    return places.take(rows)
