# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Maps of drives whose true poses are known, and what is found on them on other drives."""

import json
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.accuracy.pose_graphs import fit_motion
from fusionslam.base.arrays import Floats, Matrix
from fusionslam.base.files import atomic_path
from fusionslam.geometry.se3 import inverse, log
from fusionslam.mapping import Edge
from fusionslam.mapping.place_map import PlaceMap
from fusionslam.sensors.frame import Frame

SESSION = "first"
RIGHT = (1.0, 5.0)
"""Metres and degrees beyond which a loop is false."""
NEAR = 5.0
"""Frames at most this far from a keyframe, in metres, should be found."""
GOOD = (0.3, 2.0)
"""Metres and degrees within which a fix is good."""
STRIDE = 4
"""Each fourth frame is localised; alone, so that those between tell nothing."""
Frames = Callable[[], Iterable[Frame]]
"""Reads or makes the frames of a drive."""


@dataclass(frozen=True)
class Fix:
    """What became of a frame.

    Attributes:
        near: distance to the nearest keyframe in metres.
        error, turn: of the pose against the truth, in metres and degrees; None without a pose.
        map_error: of the pose relative to its keyframe, in metres.
        seconds: of processor time.
        reason: code of the reason without a pose.
    """

    near: float
    error: float | None
    turn: float | None
    map_error: float | None
    seconds: float
    reason: str | None


class MappedDrive:
    """A drive, its map, which the folder keeps, and the truth.

    Args:
        path: of the map, without suffix.
        true: float64 (n, 4, 4), world_from_robot of the frames.
        odometry: float64 (n, 4, 4), odom_from_robot.
        frames: reads them if there is no map yet.
        session: name of the drive.
        options: of a new map, as of ``PlaceMap.open``.
    """

    def __init__(
        self,
        path: Path,
        true: Floats,
        odometry: Floats,
        frames: Frames,
        session: str = SESSION,
        **options: Any,
    ) -> None:
        self.path, self.true, self.odometry = path.with_name(f"{path.name}.fsmap"), true, odometry
        self.session = session
        self.seconds = self._build(frames, options)
        with PlaceMap.open(self.path, read_only=True) as site:
            self.frames = site.frames(session)
            self.poses = site.trajectory(session)[1]
            self.edges, self.loops = site.edges, site.loops
            self.parts = sum(len(each.parts) for each in site.sessions)
        self.true_keyframes = true[self.frames]
        self.true_from_map = fit_motion(self.poses, self.true_keyframes)

    def _build(self, frames: Frames, options: dict[str, Any]) -> list[float]:
        """Drive; return seconds of processor time of each keyframe."""
        times = self.path.with_suffix(".json")
        if times.exists() and self.path.exists():
            return [float(value) for value in json.loads(times.read_text())]
        for suffix in ("", "-wal", "-shm"):
            Path(f"{self.path}{suffix}").unlink(missing_ok=True)
        seconds = []
        with PlaceMap.open(self.path, self.session, **options) as site:
            for frame in frames():
                started = time.process_time()
                step = site.add(frame, odometry=self.odometry[frame.number])
                if step.keyframe is not None:
                    seconds.append(time.process_time() - started)
            site.solve()
        save(times, seconds)
        return seconds

    def localize(
        self,
        name: str,
        frames: Frames,
        true: Floats,
        *,
        stride: int = STRIDE,
        view: float = 180.0,
        alone: bool = True,
    ) -> list[Fix]:
        """Localise each ``stride``-th frame of another drive, without any guess.

        Args:
            name: of the other drive, under which the folder keeps what was found.
            frames: of it.
            true: float64 (m, 4, 4), world_from_robot of them, by their numbers.
            stride: between frames that are localised.
            view: keyframes turned farther than this from a frame, in degrees, are not near it.
            alone: whether the poses of the frames before are forgotten, which confirm one by the
                frames' odometry.
        """
        path = self.path.with_name(f"{self.path.stem}-by-{name}.json")
        if path.exists():
            return [Fix(**values) for values in json.loads(path.read_text())]
        with PlaceMap.open(self.path, read_only=True) as site:
            fixes = [
                self._localize(site, frame, true[frame.number], view, alone)
                for frame in frames()
                if frame.number % stride == 0
            ]
        save(path, [asdict(fix) for fix in fixes])
        return fixes

    def _localize(
        self, site: PlaceMap, frame: Frame, true: Matrix, view: float, alone: bool
    ) -> Fix:
        apart = np.array([difference(each, true) for each in self.true_keyframes])
        near = float(apart[apart[:, 1] <= view, 0].min(initial=np.inf))
        if alone:
            site.forget_motion()
        started = time.process_time()
        found = site.localize(frame)
        seconds = time.process_time() - started
        if found.pose is None or found.keyframe is None:
            reason = None if found.reason is None else found.reason.code
            return Fix(near, None, None, None, seconds, reason)
        error, turn = difference(true, self.true_from_map @ found.pose)
        keyframe = found.keyframe
        on_map = inverse(self.poses[keyframe]) @ found.pose
        truly = inverse(self.true_keyframes[keyframe]) @ true
        return Fix(near, error, turn, difference(truly, on_map)[0], seconds, None)

    def is_false(self, edge: Edge, right: tuple[float, float] = RIGHT) -> bool:
        """Whether a loop is off by more than these metres or degrees."""
        truly = inverse(self.true_keyframes[edge.a]) @ self.true_keyframes[edge.b]
        error, turn = difference(truly, edge.pose)
        return error > right[0] or turn > right[1]


class Shares:
    """What share of the frames near a map was found, and how well.

    Args:
        fixes: of all frames.
        limit: metres from a keyframe within which a frame should be found.

    Attributes:
        near: number of frames within the limit.
        found: share of them that were found.
        good: share of the fixes that are ``GOOD``.
        worst: float64 (3,), largest error and turn against the truth, and error against the map.
        seconds: median and 95 % of the processor time of a frame.
    """

    def __init__(self, fixes: Sequence[Fix], limit: float = NEAR) -> None:
        near = [fix for fix in fixes if fix.near <= limit]
        # Columns: error and turn against the truth, error against the map.
        errors = np.array(
            [(fix.error, fix.turn, fix.map_error) for fix in near if fix.error is not None]
        ).reshape(-1, 3)
        good = (errors[:, 0] <= GOOD[0]) & (errors[:, 1] <= GOOD[1])
        self.near, self.found = len(near), len(errors) / len(near)
        self.good, self.worst = float(good.mean()), errors.max(axis=0)
        self.seconds = np.percentile([fix.seconds for fix in near], [50, 95])

    def cells(self) -> list[str]:
        """Cells of a table, as ``SHARES`` names them."""
        return [
            *(str(self.near), f"{self.found:.3f}", f"{self.good:.3f}"),
            *(f"{value:.3f}" for value in self.worst),
            *(f"{value:.2f}" for value in self.seconds),
        ]


SHARES = (
    *("frames near a keyframe", "found", "good", "worst, m", "worst, degrees"),
    *("worst against the map, m", "s a frame, median", "95 %"),
)


def difference(one: Matrix, other: Matrix) -> tuple[float, float]:
    """Metres and degrees between two poses."""
    motion = inverse(one) @ other
    turn = np.degrees(np.linalg.norm(log(motion)[3:]))
    return float(np.linalg.norm(motion[:3, 3])), float(turn)


def save(path: Path, values: Sequence[object]) -> None:
    with atomic_path(path) as part:
        part.write_text(json.dumps(values))
