# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Laps round a rectangle: odometry with known errors, and views that are right unless told."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fusionslam.evaluation import MapReport, RatSlamRun, judge_map
from fusionslam.geometry.trajectory import Trajectory
from fusionslam.pipelines.map_events import RunEvents
from fusionslam.pipelines.maps import RunRecorder
from fusionslam.ratslam import Motion, RatSlam, RatSlamConfig, Sighting

SPEED, TURN, RATE = 0.5, 0.8, 10
"""m/s along the sides, rad/s at the corners, odometry a second; a view every half second."""
SIDES = (12.0, 6.0)
RADIUS = 0.5
"""Metres from a known view within which it is recognised, at the same heading."""


@dataclass(frozen=True)
class LittleCourse:
    """What happens on the way: speeds (n, 2) in m/s and rad/s, true poses (n + 1, 3), views."""

    speeds: NDArray[np.float64]
    poses: NDArray[np.float64]
    sightings: list[Sighting]

    @property
    def motions(self) -> list[Motion]:
        """The first one says when the robot begins."""
        rows = np.vstack([self.speeds[:1], self.speeds]).tolist()
        return [Motion(i * 10**9 // RATE, v, w) for i, (v, w) in enumerate(rows)]

    def drifting(self, times: float = 1.0) -> "LittleCourse":
        """2 % too far, turns 1 % too wide, or so many times that."""
        return replace(self, speeds=self.speeds * (1 + 0.02 * times, 1 + 0.01 * times))

    def misled(self, share: float, seed: int = 0) -> "LittleCourse":
        """Some known views are taken for others, at least twice the radius away."""
        luck = np.random.default_rng(seed)
        told: list[Sighting] = []
        first: list[NDArray[np.float64]] = []
        for sighting in self.sightings:
            here = self.pose_at(sighting)[:2]
            if sighting.view_id == len(first):
                first.append(here)
                told.append(sighting)
                continue
            far = np.flatnonzero(np.linalg.norm(np.array(first) - here, axis=1) > 2)
            wrong = luck.random() < share and far.size > 0
            told.append(Sighting(sighting.stamp_ns, int(luck.choice(far))) if wrong else sighting)
        return replace(self, sightings=told)

    def pose_at(self, sighting: Sighting) -> NDArray[np.float64]:
        return np.asarray(self.poses[sighting.stamp_ns * RATE // 10**9])

    def run(self, config: RatSlamConfig) -> RatSlamRun:
        seconds = np.arange(len(self.poses)) / RATE
        x, y, yaw = self.poses.T
        stamps = np.array([sighting.stamp_ns for sighting in self.sightings])
        item = self.sightings.__getitem__
        truth = Trajectory(seconds, x, y, yaw)
        events = RunEvents("laps", "wheels", self.motions, stamps, item, truth)
        recorder = RunRecorder(RatSlam(config), events)
        for event in events:
            recorder.step(getattr(event, "item", event))
        return recorder.record()

    def judged(self, config: RatSlamConfig) -> MapReport:
        return judge_map(self.run(config))


def laps(count: int = 3, *, measured: bool = True) -> LittleCourse:
    """``measured``: views tell where the robot is in their frame; else no more than their id."""
    speeds = np.array([speed for _ in range(count) for side in SIDES * 2 for speed in _side(side)])
    poses = np.zeros((len(speeds) + 1, 3))
    for i, (v, w) in enumerate(speeds):
        heading = poses[i, 2] + w / RATE
        poses[i + 1] = (*(poses[i, :2] + v / RATE * _direction(heading)), heading)
    return LittleCourse(speeds, poses, _sightings(poses, measured))


def _side(metres: float) -> list[tuple[float, float]]:
    turn = round(np.pi / 2 / TURN * RATE)
    straight = [(SPEED, 0.0)] * round(metres / SPEED * RATE)
    return straight + [(0.0, np.pi / 2 / turn * RATE)] * turn


def _sightings(poses: NDArray[np.float64], measured: bool) -> list[Sighting]:
    known: list[NDArray[np.float64]] = []
    found = []
    for i in range(0, len(poses), RATE // 2):
        nearest, place = _nearest(known, poses[i])
        if nearest == len(known):
            known.append(poses[i])
        x, y, turn = place if measured else (0.0, 0.0, 0.0)
        found.append(Sighting(i * 10**9 // RATE, nearest, turn, (x, y)))
    return found


def _nearest(
    known: list[NDArray[np.float64]], pose: NDArray[np.float64]
) -> tuple[int, tuple[float, float, float]]:
    """The nearest known view and the pose in its frame; a new one if none is near."""
    best, found = RADIUS, (len(known), (0.0, 0.0, 0.0))
    for number, view in enumerate(known):
        apart, turn = (
            pose[:2] - view[:2],
            np.remainder(pose[2] - view[2] + np.pi, 2 * np.pi) - np.pi,
        )
        if np.hypot(*apart) < best and abs(turn) < 0.3:
            forward = _direction(view[2])
            left = np.array([-forward[1], forward[0]])
            best = float(np.hypot(*apart))
            found = number, (float(apart @ forward), float(apart @ left), float(turn))
    return found


def _direction(heading: float) -> NDArray[np.float64]:
    return np.array([np.cos(heading), np.sin(heading)])
