# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Views recognised by another process, which may restart while the map is kept."""

import json
import logging
import math
import operator
from dataclasses import dataclass
from typing import Any

from fusionslam.errors import DataError
from fusionslam.ratslam.events import Sighting
from fusionslam.views.match import NO_VIEW

logger = logging.getLogger(__name__)

# Sanity limits: larger offsets from a view, or angles of many turns, are errors.
_FARTHEST_M, _FARTHEST_RAD = 1000.0, 100.0


@dataclass(frozen=True)
class GivenView:
    """A view recognised by another process; the item of a ``Look``.

    Attributes:
        view_id: that process's id; -1 if nothing was recognised.
        is_new: True if that process sees the view for the first time.
        relative_rotation: rotation of the robot relative to the view, radians, counter-clockwise.
        relative_place: position of the robot in the view's frame, metres, x forward and y left.
        reason: the reason for this view, as a sentence.
    """

    view_id: int
    is_new: bool
    relative_rotation: float = 0.0
    relative_place: tuple[float, float] = (0.0, 0.0)
    reason: str = ""


class GivenViews:
    """A view source whose ids come from another process.

    The map numbers views itself, without gaps; the numbers equal the ids unless the process or the
    map restarts. A view reported as new means that the process knows no view from that id on: if
    the map knows some, they were lost, and those ids now mean other places, which get new numbers.
    An id that is not new but unknown to the map belongs to a place from before the map began, and
    gets a new number, too.

    Attributes:
        restarts: number of times that views were lost or unknown.
    """

    kind = title = "given ids"

    def __init__(self) -> None:
        self.restarts = 0
        self._count = 0
        # The number on the map by the process's id.
        self._numbers: dict[int, int] = {}
        self._beyond = 0

    @property
    def known(self) -> int:
        return self._count

    def look(self, item: Any, stamp_ns: int) -> Sighting:
        """Number the view; ``item`` is a ``GivenView``."""
        given = _check_view(item)
        place, turn, reason = given.relative_place, given.relative_rotation, given.reason
        if given.view_id == NO_VIEW:
            return Sighting(stamp_ns, NO_VIEW, turn, place, reason)
        view_id = operator.index(given.view_id)
        if given.is_new:
            self._forget_from(view_id)
        elif view_id not in self._numbers:
            self._log_restart(f"view {view_id} is older than this map")
        number = self._numbers.get(view_id, self._count)
        if number == self._count:
            self._numbers[view_id] = number
            self._count, self._beyond = self._count + 1, max(self._beyond, view_id + 1)
        if number != view_id:
            reason = f"{reason or f'view {view_id}'}; view {number} of this map"
        return Sighting(stamp_ns, number, turn, place, reason)

    def _forget_from(self, view_id: int) -> None:
        """Forget all views from this id on: the process has just reported it as new."""
        if view_id >= self._beyond:
            return
        kept = {known: number for known, number in self._numbers.items() if known < view_id}
        lost = len(self._numbers) - len(kept)
        self._numbers, self._beyond = kept, view_id
        if lost:
            self._log_restart(f"view {view_id} is new again: {lost} views were lost")

    def _log_restart(self, why: str) -> None:
        level = logging.INFO if self.restarts else logging.WARNING
        self.restarts += 1
        logger.log(level, "%s; the map gives it a new number", why)

    def to_bytes(self) -> bytes:
        return json.dumps({"count": self._count, "numbers": [*self._numbers.items()]}).encode()

    def restore(self, content: bytes) -> None:
        try:
            stored = json.loads(content)
            count, numbers = operator.index(stored["count"]), dict(stored["numbers"])
            fits = all(0 <= operator.index(number) < count for number in numbers.values())
            fits &= all(operator.index(view_id) >= 0 for view_id in numbers)
        except (ValueError, KeyError, TypeError) as error:
            raise DataError(f"no stored ids of views: {error!r}") from error
        if not fits:
            raise DataError(f"stored ids of views: expected none of {count} or more")
        self._count, self._numbers, self._beyond = count, numbers, max(numbers, default=-1) + 1


def _check_view(item: Any) -> GivenView:
    """Raise DataError for an invalid view, before anything is counted."""
    if not isinstance(item, GivenView):
        raise DataError(f"{type(item).__name__}: expected a GivenView")
    try:
        view_id, (x, y) = operator.index(item.view_id), item.relative_place
        way, turn = math.hypot(x, y), abs(float(item.relative_rotation))
    except (TypeError, ValueError) as error:
        raise DataError(f"{item}: expected a whole id, an angle, and x, y") from error
    if view_id < NO_VIEW:
        raise DataError(f"view {view_id}: expected -1 or more")
    # Written so that NaN fails, too.
    if not (way <= _FARTHEST_M and turn <= _FARTHEST_RAD):
        raise DataError(
            f"view {view_id}: {way:g} m and {turn:g} rad from the robot, expected no more than "
            f"{_FARTHEST_M:g} m and {_FARTHEST_RAD:g} rad"
        )
    return item
