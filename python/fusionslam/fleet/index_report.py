# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What a table of places tells of its index: how good it is, and how it is searched."""

import logging
import re
from dataclasses import asdict, dataclass
from typing import Any, Literal

from fusionslam.errors import DataError
from fusionslam.storage.archive import dump_sealed, parse_sealed

logger = logging.getLogger(__name__)

Kind = Literal["faiss", "lance", "exact"]
"""An IVF of FAISS or LanceDB, one byte a value, or none."""

_KEY = "fusionslam.index"
_SEGMENT = re.compile(r"[0-9a-f]{16}\.faiss")


@dataclass(frozen=True)
class IndexReport:
    """How good the index of a table is, and how it is searched; by default, without an index.

    Attributes:
        rows: of the table when the index was built.
        last_row: the greatest number of a row that it had then.
        partitions: number of the index's lists, about; 0 without index.
        kind: FAISS's segment beside the table, LanceDB's own index, or "exact" for a small table,
            which has no index.
        nprobes: partitions searched by a query.
        candidates: rows that are compared exactly.
        wanted: recall that was asked for.
        recall: share of the true ten nearest that queries find.
        first: share of queries that find the true nearest.
        queries: number of them that recall was measured with.
        seconds: that building and measuring took.
        index: identity of the index that was measured: name of the segment, or LanceDB's.
        size: of the segment's files, bytes.
        sha256: of the segment's files, as of ``segment.digest_of``.
    """

    rows: int
    last_row: int
    partitions: int = 0
    kind: Kind = "exact"
    nprobes: int = 0
    candidates: int = 0
    wanted: float = 1.0
    recall: float = 1.0
    first: float = 1.0
    queries: int = 0
    seconds: float = 0.0
    index: str = ""
    size: int = 0
    sha256: str = ""

    def __post_init__(self) -> None:
        if self.kind == "faiss" and not _SEGMENT.fullmatch(self.index):
            raise ValueError(f"{self.index!r} is no name of a segment")


def read_report(table: Any) -> IndexReport | None:
    """Return the report that a table carries; None, and a line in the log, if it is damaged."""
    text = (table.schema.field("vector").metadata or {}).get(_KEY.encode())
    try:
        return IndexReport(**parse_sealed(text)) if text else None
    except (DataError, ValueError, TypeError) as error:
        logger.warning("the report of an index cannot be read: %s", error)
        return None


def write_report(table: Any, report: IndexReport) -> None:
    """Store a report in the table, which is one commit."""
    table.update_field_metadata({"path": "vector", "metadata": {_KEY: dump_sealed(asdict(report))}})
