# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Merges the scans of several scanners on one robot into one."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fusionslam import _core
from fusionslam.base.arrays import Floats
from fusionslam.sensors.messages import NANOSECONDS, Scan
from fusionslam.sensors.transforms import TransformError, TransformTree

LEADER = "points"
_POSES = 33
_VALUES = ("intensity", "object")
"""Values of points that mean the same for every scanner, unlike numbers of rings."""


class Partner(NamedTuple):
    """A scan to merge into the leading one.

    Attributes:
        offset_ns: from the leading scan's stamp to its own.
        scan: of a further scanner.
    """

    offset_ns: int
    scan: Scan


def merge_scans(
    leader: Scan,
    partners: Mapping[str, Partner],
    tree: TransformTree,
    leave_out: Callable[[str, TransformError], None],
    stamp_ns: int | None = None,
) -> Scan:
    """Merge scans into one in the leader's frame, with the time at which each point was measured.

    Between its own time and the leader's stamp a point is not moved: undoing the motion within the
    merged scan does that. Points whose times are unknown are of their scan's stamp.

    Args:
        leader: its points come first; those of the partners follow, by name.
        partners: by name of the scanner.
        tree: places the partners' frames in the leader's.
        leave_out: gets the name of each partner that the tree does not place at its time, and the
            reason; if it returns, the others are merged.
        stamp_ns: of the leader by the clock of the tree, if that is another one than the scan's.

    Returns:
        Without rays that did not return; the leader itself where no partner is left. Of the fields
        it has "time" (float64, seconds after the stamp) unless all points are of that moment, and
        "intensity" and "object" where all scans have them; colours likewise.
    """
    scans, seconds = [leader.returns], [_seconds_of(Partner(0, leader))]
    for name, partner in sorted(partners.items()):
        start_ns = leader.stamp_ns if stamp_ns is None else stamp_ns
        measured = _seconds_of(partner)
        span = (float(measured.min()), float(measured.max())) if len(measured) else (0.0, 0.0)
        stamps_ns = start_ns + np.round(np.linspace(*span, _POSES) * NANOSECONDS).astype(np.int64)
        scan = partner.scan.returns
        try:
            places = tree.lookup_all(leader.frame_id, scan.frame_id, stamps_ns)
        except TransformError as error:
            leave_out(name, error)
            continue
        # As a scanner may move on the robot, each point is placed by the poses about its time.
        scans.append(replace(scan, points=_core.deskew(scan.points, measured, places, span)))
        seconds.append(measured)
    if len(scans) == 1:
        return scans[0]
    times = np.concatenate(seconds)
    fields: dict[str, NDArray[Any]] = {
        name: np.concatenate([scan.fields[name] for scan in scans])
        for name in _VALUES
        if all(name in scan.fields for scan in scans)
    }
    if times.any():
        fields["time"] = times
    colors = [scan.colors for scan in scans if scan.colors is not None]
    return Scan(
        stamp_ns=leader.stamp_ns,
        frame_id=leader.frame_id,
        points=np.concatenate([scan.points for scan in scans]),
        fields=fields,
        colors=np.concatenate(colors) if len(colors) == len(scans) else None,
    )


def time_remarks(leader: Scan, partners: Mapping[str, Partner], merged: Scan) -> dict[str, str]:
    """Say what is unusual about times of points, by scanner; the leader is "points"."""
    remarks = {LEADER: leader.returns.point_times.remark or merged.point_times.remark}
    for name, partner in partners.items():
        scans = leader.returns, partner.scan.returns
        lacking = [scan for scan in scans if scan.point_seconds is None and len(scan.points)]
        remark = scans[1].point_times.remark
        if not remark and len(lacking) == 1:
            remark = (
                f"points of '{lacking[0].frame_id}' have no times, those of another scanner do: "
                "they are taken as measured at their scans' stamps"
            )
        remarks[name] = remark and f"{name}: {remark}"
    return {name: remark for name, remark in remarks.items() if remark}


def _seconds_of(partner: Partner) -> Floats:
    """float64 (M,): seconds from the leader's stamp to when each return was measured."""
    scan = partner.scan.returns
    offset, seconds = partner.offset_ns / NANOSECONDS, scan.point_seconds
    return np.full(len(scan.points), offset) if seconds is None else offset + seconds
