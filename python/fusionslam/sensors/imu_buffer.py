# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""How an inertial measurement unit turned between any two times."""

import logging
from bisect import bisect_left, bisect_right
from collections.abc import Callable, Iterable
from threading import Lock
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from fusionslam.base.arrays import Floats
from fusionslam.errors import DataError
from fusionslam.sensors.messages import NANOSECONDS, Imu, as_stamp
from fusionslam.sensors.transforms import TransformError

logger = logging.getLogger(__name__)

_WIDEST_NS = NANOSECONDS // 20
"""Between rates farther apart the turn is not known."""


class ImuBuffer:
    """Turn rates of one IMU, and what they add up to.

    Args:
        history_s: how long rates are kept, in seconds before the newest; None for all.
        load: gives all messages when they are first asked for, as of a bag; None if they are added.
    """

    def __init__(
        self, history_s: float | None = None, load: Callable[[], Iterable[Imu]] | None = None
    ) -> None:
        self._history_ns = None if history_s is None else round(history_s * NANOSECONDS)
        self._load = load
        self._lock = Lock()
        self._rates: list[tuple[int, tuple[float, ...]]] = []
        self._frame: str | None = None
        self._is_distrusted = False

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in vars(self).items() if name != "_lock"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state, _lock=Lock())

    @property
    def frame(self) -> str | None:
        """The frame of its axes; None before the first message."""
        self._read()
        return self._frame

    @property
    def newest(self) -> int | None:
        """Stamp of the last message; None if there is none."""
        return self._rates[-1][0] if self._rates else None

    def add(self, imu: Imu, jump_ns: int | None = None) -> None:
        """Take a message, which may arrive out of order; of equal stamps the first counts.

        Args:
            imu: what it says.
            jump_ns: a stamp farther behind the newest one starts all anew; None never does.

        Raises:
            DataError: its frame is another one than before (code "two-imus"), or its stamp or turn
                rate is none.
        """
        stamp_ns = as_stamp(imu.stamp_ns)
        rate = tuple(np.ravel(np.asarray(imu.angular, object)).tolist())
        if len(rate) != 3 or not all(isinstance(each, int | float) for each in rate):
            raise DataError(f"turn rate {imu.angular!r} of an IMU: expected three numbers, rad/s")
        if not np.isfinite(rate).all():
            raise DataError(f"turn rate {rate} of an IMU is not finite", code="not-finite")
        if jump_ns is not None and self._rates and self._rates[-1][0] - stamp_ns > jump_ns:
            self.forget_after(0)
        if self._frame not in (None, imu.frame_id):
            raise DataError(
                f"IMU messages of '{imu.frame_id}', expected those of '{self._frame}' as before",
                code="two-imus",
                fields=(imu.frame_id, str(self._frame)),
            )
        self._frame = imu.frame_id
        row = bisect_left(self._rates, (stamp_ns,))
        if row == len(self._rates) or self._rates[row][0] != stamp_ns:
            self._rates.insert(row, (stamp_ns, rate))
        if self._history_ns is not None:
            count = bisect_left(self._rates, (self._rates[-1][0] - self._history_ns,))
            del self._rates[:count]

    def forget_after(self, stamp_ns: int) -> None:
        """Drop messages later than a stamp, to which the clock jumped back."""
        del self._rates[bisect_right(self._rates, (stamp_ns, (np.inf,) * 3)) :]
        if not self._rates:
            self._frame = None

    def distrust(self, turned_deg: float, expected_deg: float) -> None:
        """Say once that odometry contradicts it."""
        if not self._is_distrusted:
            self._is_distrusted = True
            logger.warning(
                "the IMU in '%s' turns by %.1f degrees within a scan, odometry by %.1f: it is not "
                "used there; are its rates in rad/s, and does TF place it rightly?",
                self._frame,
                turned_deg,
                expected_deg,
            )

    def turned(self, stamps_ns: NDArray[np.int64]) -> Floats:
        """float64 (K, 3, 3): first_from_then, its axes at the first of some times and at each.

        Rates are taken to change evenly between messages.

        Raises:
            TransformError: rates are not known around a time; ``may_come`` says whether they may be
                later.
        """
        self._read()
        first, last = int(stamps_ns.min()), int(stamps_ns.max())
        begin = bisect_right(self._rates, (first, (np.inf,) * 3)) - 1
        end = bisect_left(self._rates, (last,))
        if begin < 0 or end >= len(self._rates):
            is_late = bool(self._rates) and begin >= 0
            raise TransformError(
                f"the turn of '{self._frame}' is not known from {first / NANOSECONDS:.3f} to "
                f"{last / NANOSECONDS:.3f} s",
                may_come=is_late or not self._rates,
                code="too-late" if is_late else "too-early",
                fields=(str(self._frame),),
            )
        used = self._rates[begin : end + 1]
        times = np.array([stamp for stamp, _ in used])
        rates = np.array([rate for _, rate in used])
        gaps = np.diff(times)
        if len(gaps) and gaps.max() > _WIDEST_NS:
            raise TransformError(
                f"the turn of '{self._frame}' is not known for {gaps.max() / NANOSECONDS:.3f} s "
                f"around {first / NANOSECONDS:.3f} s, expected rates at most "
                f"{_WIDEST_NS / NANOSECONDS:g} s apart",
                may_come=False,
                code="gap",
                fields=(str(self._frame),),
            )
        return _integrate(times, rates, stamps_ns)

    def _read(self) -> None:
        with self._lock:
            if self._load is None:
                return
            problem: DataError | None = None
            for imu in self._load():
                try:
                    self.add(imu)
                except DataError as error:
                    problem = problem or error
            self._load = None
        if problem is not None:
            logger.warning("messages of an IMU are left out: %s", problem)


def _integrate(times_ns: NDArray[np.int64], rates: Floats, stamps_ns: NDArray[np.int64]) -> Floats:
    """Turns from the first stamp on, (K, 3, 3), by rates (M, 3) at times around all stamps."""
    every = np.union1d(times_ns, stamps_ns)
    at_all = np.stack([np.interp(every, times_ns, axis) for axis in rates.T], axis=1)
    steps_s = np.diff(every) / NANOSECONDS
    turns = Rotation.from_rotvec((at_all[:-1] + at_all[1:]) / 2 * steps_s[:, None]).as_matrix()
    since = np.empty((len(every), 3, 3))
    since[0] = np.eye(3)
    for row, turn in enumerate(turns):
        since[row + 1] = since[row] @ turn
    rows = np.searchsorted(every, stamps_ns)
    result: Floats = since[rows[0]].T @ since[rows]
    return result
