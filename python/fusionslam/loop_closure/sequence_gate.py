# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Loops that are not certain by themselves count if those of neighbouring frames agree."""

from collections import deque
from dataclasses import dataclass, replace

import numpy as np

from fusionslam.loop_closure.config import LoopConfig
from fusionslam.loop_closure.loop import Loop
from fusionslam.registration.result import Refusal
from fusionslam.storage.arrays import Matrix

_FRAMES = 4
_SOFT = ("improbable", "low-overlap")


@dataclass(frozen=True)
class _Recent:
    """A frame's best candidate, and the odometry of both of its frames."""

    match_from_query: Matrix
    query: Matrix
    match: Matrix
    stretches: tuple[int, int]


class SequenceGate:
    """Remembers the best candidates of the last frames.

    Two agree if odometry, between both queries and between both matches, joins their poses within
    its drift and three standard deviations of theirs.
    """

    def __init__(self, config: LoopConfig) -> None:
        self._config = config
        self._recent: deque[_Recent | None] = deque(maxlen=_FRAMES - 1)

    def judge(
        self,
        best: Loop | None,
        query: Matrix | None,
        match: Matrix | None,
        stretches: tuple[int, int] = (0, 0),
    ) -> Loop | None:
        """Return the candidate, without its reason if another recent one agrees with it.

        Args:
            best: of the frame.
            query, match: float64 (4, 4), odom_from_cloud of both frames; None if unknown.
            stretches: numbers of the stretches of odometry that both belong to; odometry of
                different ones, as of two sessions, cannot be compared.
        """
        entry = self._entry(best, query, match, stretches)
        judged = best
        if best is not None and best.reason is not None and entry is not None:
            if any(self._agree(entry, other) for other in self._recent if other is not None):
                judged = replace(best, reason=None)
            else:
                probability = best.probability or 0.0
                text = f"probability {probability:.2f}, and no recent loop agrees"
                judged = replace(best, reason=Refusal("alone", probability, text))
        self._recent.append(entry)
        return judged

    def _entry(
        self,
        best: Loop | None,
        query: Matrix | None,
        match: Matrix | None,
        stretches: tuple[int, int],
    ) -> _Recent | None:
        if best is None or best.match_from_query is None or best.covariance is None:
            return None
        if query is None or match is None:
            return None
        counts = best.reason is None or best.reason.code in _SOFT
        if not counts or (best.probability or 0.0) < self._config.min_supported:
            return None
        return _Recent(best.match_from_query, query, match, stretches)

    def _agree(self, one: _Recent, other: _Recent) -> bool:
        from scipy.spatial.transform import Rotation

        if one.stretches != other.stretches:
            return False
        queries = np.linalg.inv(other.query) @ one.query  # other_from_one
        matches = np.linalg.inv(other.match) @ one.match
        joined = np.linalg.inv(other.match_from_query @ queries) @ matches @ one.match_from_query
        way = float(np.linalg.norm(queries[:3, 3]) + np.linalg.norm(matches[:3, 3]))
        off = float(np.linalg.norm(joined[:3, 3]))
        turned = float(np.degrees(Rotation.from_matrix(joined[:3, :3]).magnitude()))
        config = self._config
        return off <= _FLOOR_M + config.drift * way and turned <= _FLOOR_DEG + (
            config.drift_angle * way
        )


_FLOOR_M, _FLOOR_DEG = 0.3, 1.5
"""Three standard deviations of two registered poses."""
