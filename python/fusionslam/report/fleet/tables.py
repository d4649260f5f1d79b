# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Tables of the page of a fleet."""

from collections import Counter
from collections.abc import Sequence

from fusionslam.fleet.encounters import Encounter
from fusionslam.fleet.work import Failure, Status
from fusionslam.report.page.tables import DASH, Cell, Column, Table, build_table

MOST = 200
"""Largest number of failures in the table."""

_RECORDING_COLUMNS: tuple[Column[Status], ...] = (
    Column("site", "where it was driven", lambda each: each.recording.site or None),
    Column("robot", "who drove", lambda each: each.recording.robot or None),
    Column("frames", "number of them", "frames", "{:,}"),
    Column("described", "frames whose chunk is stored", "done", "{:,}"),
    Column("failed", "frames of chunks that could not be described", "failed", "{:,}"),
)


def recording_table(status: Sequence[Status]) -> Table:
    """Build the table of recordings."""
    return build_table(_RECORDING_COLUMNS, status, [each.recording.session for each in status])


def failure_table(failures: Sequence[Failure]) -> Table | None:
    """Build the table of failures; None without any."""
    if not failures:
        return None
    heads = [
        ("from frame", "first one of the chunk"),
        ("kind", "of the problem"),
        ("reason", "of the last try"),
        ("tries", "how often it was tried"),
    ]
    rows = [
        (
            each.session,
            [
                Cell(DASH if each.first is None else str(each.first)),
                Cell(each.code),
                Cell(each.reason),
                Cell(str(each.tries)),
            ],
        )
        for each in failures[:MOST]
    ]
    return Table(heads, rows)


def encounter_table(encounters: Sequence[Encounter]) -> Table | None:
    """Count the places of each drive that were proven in each other one; None without any."""
    sessions = sorted({each.session for each in encounters})
    others = sorted({e.found.place.session for e in encounters if e.found.place is not None})
    if not others:
        return None
    heads = [("asked", "places of the drive that were looked for in all others")]
    heads += [(other, "places that were proven in this drive") for other in others]
    rows = []
    for session in sessions:
        own = [each.found for each in encounters if each.session == session]
        counts = Counter(each.place.session for each in own if each.place is not None)
        cells = [Cell(DASH if other == session else str(counts[other])) for other in others]
        rows.append((session, [Cell(str(len(own))), *cells]))
    return Table(heads, rows)
