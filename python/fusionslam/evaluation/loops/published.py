# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Published KITTI figures, for comparison with those measured here."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from fusionslam.base.argument_types import checked

CITATION = (
    "Perdomo 2019, c-M2DP: KITTI odometry, radius 10 m, window 50 frames, protocol perdomo2019; "
    "times are means over KITTI 05 on an i7 at 2.0 GHz, matching took 4 to 6 ms a query"
)

_STORED: dict[str, Any] = yaml.safe_load(
    Path(__file__).with_name("published.yaml").read_text(encoding="utf-8")
)
_THESIS: dict[str, Any] = _STORED["perdomo2019"]
FRAMES: dict[str, int] = _STORED["frames"]
"""Frames of the sequences."""


def _table(figure: str) -> dict[tuple[str, str, str], float]:
    columns = [(source, name) for source in ("lidar", "stereo") for name in _THESIS["descriptors"]]
    return {
        (sequence, *column): value
        for sequence, values in _THESIS[figure].items()
        for column, value in zip(columns, values, strict=True)
    }


PUBLISHED_RECALL = _table("recall_at_full_precision")
"""(sequence, source, descriptor) -> recall at 100 % precision, protocol perdomo2019."""
PUBLISHED_SECONDS = _table("describe_seconds")
"""(sequence, source, descriptor) -> seconds to describe one cloud."""
PUBLISHED_MATCH_SECONDS = _table("match_seconds")
"""(sequence, source, descriptor) -> seconds to find the nearest of all earlier descriptors."""
PUBLISHED_COLOR_SPACES = {name: tuple(both) for name, both in _THESIS["color_spaces"].items()}
"""Colour space -> recall at 100 and at 90 % precision of c-M2DP on KITTI 06, LiDAR and camera
(Perdomo 2019, 4.2)."""


@checked
def kitti_sequence(dataset: str) -> str | None:
    """Return the sequence in a dataset's name ("KITTI 06", "kitti/sequences/06"), or None."""
    found = re.fullmatch(r"kitti\D*(\d\d)", dataset.strip(), flags=re.IGNORECASE)
    return found[1] if found else None


@checked
def published_figures(
    sequence: str | None, source: str, descriptor: str, frames: int
) -> dict[str, float] | None:
    """Return the published figures (``CITATION``), or None if nothing was published.

    Args:
        sequence: of KITTI odometry, two digits; None for other data.
        source: of the clouds, "lidar" or "stereo".
        descriptor: its name.
        frames: number of frames that are judged; the figures are of whole sequences.

    Returns:
        ``recall_at_full_precision`` (protocol perdomo2019) and, where it was published for this
        sequence, ``describe_seconds``.
    """
    key = (sequence or "", source, descriptor)
    if key not in PUBLISHED_RECALL or frames != FRAMES[key[0]]:
        return None
    figures = {"recall_at_full_precision": PUBLISHED_RECALL[key]}
    if key in PUBLISHED_SECONDS:
        figures["describe_seconds"] = PUBLISHED_SECONDS[key]
    return figures


@dataclass(frozen=True)
class PeerFigures:
    """Figures that another paper prints of one method on one sequence of KITTI odometry.

    Attributes:
        protocol: under which they hold.
        sequence: two digits.
        method: as the paper calls it.
        descriptor: its name here; None if it is none of ours.
        figures: by attribute of ``PrecisionRecall``.
        source: the paper and its table.
    """

    protocol: str
    sequence: str
    method: str
    descriptor: str | None
    figures: Mapping[str, float] = field(hash=False)
    source: str


PEERS = tuple(
    PeerFigures(
        protocol=protocol,
        sequence=sequence,
        method=method,
        descriptor=part["descriptors"].get(method),
        figures=dict(zip(part["figures"], values, strict=True)),
        source=part["source"],
    )
    for protocol, part in _STORED["peers"].items()
    for method, rows in part["methods"].items()
    for sequence, values in rows.items()
)
"""All figures of other papers, in the order of their tables."""


@checked
def peer_figures(protocol: str, sequence: str | None, frames: int) -> tuple[PeerFigures, ...]:
    """Return what other papers print under a protocol; none for parts of a sequence.

    Args:
        protocol: its name.
        sequence: of KITTI odometry, two digits; None for other data.
        frames: number of frames that are judged; the figures are of whole sequences.
    """
    if frames != FRAMES.get(sequence or ""):
        return ()
    return tuple(peer for peer in PEERS if (peer.protocol, peer.sequence) == (protocol, sequence))
