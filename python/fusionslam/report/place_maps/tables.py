# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Tables of the page of a map: sessions, loops by state and reason, refused loops."""

from collections.abc import Sequence

import numpy as np

from fusionslam.mapping import Edge
from fusionslam.report.page.tables import Cell, Column, Table, build_table
from fusionslam.report.place_maps.contents import Drive

MOST = 200
"""Largest number of refused loops in the table."""

_DRIVE_COLUMNS: tuple[Column[Drive], ...] = (
    Column("keyframes", "number of them", lambda drive: len(drive.numbers), "{:,}"),
    Column("driven, m", "length of the way by odometry", "metres", "{:,.0f}"),
    Column(
        "parts",
        "of the map that the session is in; their poses have nothing to do with each other",
        lambda drive: len(np.unique(drive.parts)),
    ),
)
_ERROR_COLUMNS: tuple[Column[Drive], ...] = (
    Column(
        "ATE of odometry, m",
        "root mean square of the distances to the truth, after turning and shifting onto it",
        "odometry_error",
        "{:.2f}",
    ),
    Column("ATE, m", "the same of the map, each part by itself", "error", "{:.2f}"),
)


def session_table(drives: Sequence[Drive]) -> Table:
    """Build the table of sessions, with errors where the truth is known."""
    judged = any(drive.error is not None for drive in drives)
    columns = [*_DRIVE_COLUMNS, *(_ERROR_COLUMNS if judged else ())]
    return build_table(columns, drives, [drive.name for drive in drives])


def state_table(loops: Sequence[Edge]) -> Table | None:
    """Count loops by state and reason; None without loops."""
    kinds: dict[tuple[str, str], list[Edge]] = {}
    for edge in loops:
        code = "" if edge.reason is None else edge.reason.code
        kinds.setdefault((edge.state, code), []).append(edge)
    rows = []
    for (state, code), edges in sorted(kinds.items(), key=lambda item: -len(item[1])):
        numbers = [edge.reason.number for edge in edges if edge.reason is not None]
        median = f"{np.median(numbers):.3g}" if numbers else ""
        merges = sum(edge.kind == "merge" for edge in edges)
        rows.append((state, [Cell(code), Cell(str(len(edges))), Cell(str(merges)), Cell(median)]))
    heads = [
        ("reason", "why a loop is refused"),
        ("loops", "how many"),
        ("between sessions", "how many of them join two sessions"),
        ("number, median", "by how much, as the reason says it"),
    ]
    return Table(heads, rows) if rows else None


def refused_table(loops: Sequence[Edge]) -> Table | None:
    """List refused loops with their reasons, at most ``MOST``; None without one."""
    refused = [edge for edge in loops if edge.state == "refused"][:MOST]
    rows = []
    for edge in refused:
        reason = edge.reason
        texts = ["", "", ""]
        if reason is not None:
            texts = [reason.code, f"{reason.number:.3g}", reason.text]
        rows.append((f"{edge.a} and {edge.b}", [Cell(text) for text in texts]))
    heads = [
        ("reason", "its code"),
        ("number", "by how much, as the reason says it"),
        ("in words", "the reason"),
    ]
    return Table(heads, rows) if rows else None
