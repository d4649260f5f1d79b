# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Which belief over places tells look-alike ones apart? A Markdown table of the filter of places, a
hidden Markov model over stored views, and particles.

python -m benchmarks.accuracy.place_beliefs            # recordings, and made worlds
python -m benchmarks.accuracy.place_beliefs --write    # and put the table into the docs

All get the same scans, candidates and drifting odometry, and answer from the same probabilities on.
The other two know of drift what the filter knows of it before it has learned anything.
"""

import argparse
import math
import time
from collections.abc import Callable, Sequence
from typing import Protocol

import numpy as np

from benchmarks.accuracy.data import WORLDS, data_folder
from benchmarks.accuracy.markdown import table, write_between
from benchmarks.accuracy.place_filter import PAGE, open_made
from fusionslam.base.arrays import Floats
from fusionslam.evaluation import ViewJudge
from fusionslam.geometry.odometry_noise import DRIFT, add_odometry_errors
from fusionslam.geometry.se2 import compose, wrapped
from fusionslam.geometry.trajectory import ground_poses
from fusionslam.pipelines.drives import Drive, open_drive
from fusionslam.views import ViewMatcher
from fusionslam.views.comparison import Candidate, View
from fusionslam.views.place_filter import PlaceFilterConfig

MADE = (("house", 8), ("house", 9), ("warehouse", 3), ("hospital", 3), ("hospital", 4))
HEAD = ["drive", "belief", "accuracy, %", "loop recall, %", "loop precision, %", "ms a scan"]
_PARTICLES = 2000
_CERTAIN, _KNOWN = 0.98, 0.96
_STAY_NEW, _LEAVE = 0.9, 0.1


class PlaceBelief(Protocol):
    """Decides which stored view a scan shows."""

    def answer(self, motion: Floats, candidates: Sequence[Candidate]) -> int | None:
        """The slot of the view; -1 for a new one, which is stored; None if it is ambiguous."""


class MarkovBelief:
    """A hidden Markov model: the state is a stored view, or none of them.

    Views lie where odometry had the robot when they were stored. The robot goes from one to another
    as odometry says, within the radius of a place.
    """

    def __init__(self, config: PlaceFilterConfig) -> None:
        self._config = config
        self._here = np.zeros(3)
        self._views: Floats = np.empty((0, 3))
        self._belief = np.array([1.0])  # of each view, last that of a new one

    def answer(self, motion: Floats, candidates: Sequence[Candidate]) -> int | None:
        self._here = compose(self._here[None], motion[None])[0]
        belief = self._move(motion) * self._likelihoods(candidates)
        self._belief = belief / belief.sum()
        best = int(self._belief.argmax())
        if best < len(self._views) and self._belief[best] >= 0.5:
            near = np.hypot(*(self._views - self._views[best])[:, :2].T) < self._config.radius_m
            return best if self._belief[:-1][near].sum() >= _KNOWN else None
        if self._belief[-1] < 0.5:
            return None
        self._views = np.vstack([self._views, self._here])
        self._belief = np.append(np.zeros(len(self._views)), 0.0)
        self._belief[-2] = 1.0
        return -1

    def _move(self, motion: Floats) -> Floats:
        config, count = self._config, len(self._views)
        if not count:
            return np.array([1.0])
        moved = compose(self._views, np.tile(motion, (count, 1)))
        apart = moved[:, None] - self._views
        square = (np.hypot(apart[..., 0], apart[..., 1]) / config.radius_m) ** 2
        square += (wrapped(apart[..., 2]) / config.radius_rad) ** 2
        flow = np.exp(-square / 2) + 1e-12
        flow *= (1 - _LEAVE) / flow.sum(axis=1, keepdims=True)
        old = self._belief[:-1] @ flow + self._belief[-1] * (1 - _STAY_NEW) / count
        new = self._belief[:-1].sum() * _LEAVE + self._belief[-1] * _STAY_NEW
        return np.append(old, new)

    def _likelihoods(self, candidates: Sequence[Candidate]) -> Floats:
        values = np.full(len(self._views) + 1, 1 - _CERTAIN)
        values[-1] = 1.0
        for one in candidates:
            probability = min(one.similarity, _CERTAIN)
            values[one.slot] = max(values[one.slot], probability / (1 - probability))
        return values


class ParticleBelief:
    """Particles: poses of the robot among the stored views, moved by odometry with its drift."""

    def __init__(self, config: PlaceFilterConfig) -> None:
        self._config = config
        self._rng = np.random.default_rng(1)
        self._poses = np.zeros((_PARTICLES, 3))
        self._views: Floats = np.empty((0, 3))

    def answer(self, motion: Floats, candidates: Sequence[Candidate]) -> int | None:
        config = self._config
        way, turn = math.hypot(*motion[:2]), abs(motion[2])
        sd_m = config.drift_m * math.sqrt(way) + 1e-3
        sd_rad = math.sqrt(config.drift_turn**2 * turn + config.drift_heading**2 * way) + 1e-4
        noise = self._rng.normal(size=self._poses.shape) * [sd_m, sd_m, sd_rad]
        self._poses = compose(self._poses, motion + noise)
        weights = np.ones(_PARTICLES)
        area = float((np.ptp(self._views[:, :2], axis=0) + 5).prod()) if len(self._views) else 1.0
        likely = [c for c in candidates if c.similarity >= config.least and c.relative_pose]
        for one in likely:
            claimed = compose(self._views[one.slot][None], np.array([one.relative_pose]))[0]
            probability = min(one.similarity, _CERTAIN)
            apart = self._poses - claimed
            square = (np.hypot(apart[:, 0], apart[:, 1]) / config.place_m) ** 2
            square += (wrapped(apart[:, 2]) / config.place_rad) ** 2
            size = (2 * math.pi) ** 1.5 * config.place_m**2 * config.place_rad
            odds = probability / (1 - probability) * area * 2 * math.pi / size
            weights += odds * np.exp(-square / 2)
        right = 1 - 1 / weights  # that a candidate is, by each particle
        weights /= weights.sum()
        known = float((weights * right).sum())
        if likely:
            rows = self._rng.choice(_PARTICLES, _PARTICLES, p=weights)
            self._poses = self._poses[rows]
        slot = self._locate()
        if slot is not None:
            return slot
        return self._store() if known < 0.5 else None

    def _locate(self) -> int | None:
        """The oldest view at which nearly all particles are."""
        if not len(self._views):
            return None
        middle = np.median(self._poses, axis=0)
        near = np.flatnonzero(np.hypot(*(self._views - middle)[:, :2].T) < self._config.radius_m)
        for slot in near.tolist():
            apart = self._poses - self._views[slot]
            inside = np.hypot(apart[:, 0], apart[:, 1]) < self._config.radius_m
            inside &= np.abs(wrapped(apart[:, 2])) < self._config.radius_rad
            if inside.mean() >= _KNOWN:
                return int(slot)
        return None

    def _store(self) -> int:
        headings = self._poses[:, 2]
        heading = math.atan2(np.sin(headings).mean(), np.cos(headings).mean())
        self._views = np.vstack([self._views, [*self._poses[:, :2].mean(axis=0), heading]])
        return -1


BELIEFS: dict[str, Callable[[PlaceFilterConfig], PlaceBelief] | None] = {
    "filter of places": None,
    "hidden Markov model": MarkovBelief,
    "particles": ParticleBelief,
}


def match_with(
    build: Callable[[PlaceFilterConfig], PlaceBelief] | None,
    views: Sequence[View],
    odometry: Floats,
) -> np.ndarray:
    """The id of each view by a belief, the filter of places for None."""
    matcher, ids = ViewMatcher(), []
    if build is None:
        poses = ground_poses(*odometry.T)
        return np.array(
            [matcher.process(v, odometry=p).id for v, p in zip(views, poses, strict=True)]
        )
    config, comparison = matcher.config.places, matcher.comparison
    belief, count = build(config), 0
    before = odometry[0]
    for view, here in zip(views, odometry, strict=True):
        c, s = math.cos(before[2]), math.sin(before[2])
        x, y = here[0] - before[0], here[1] - before[1]
        turn = float(wrapped(np.asarray(here[2] - before[2])))
        motion, before = np.array([c * x + s * y, c * y - s * x, turn]), here
        candidates = comparison.compare(view, config.candidates) if count else []
        slot = belief.answer(motion, candidates)
        if slot == -1:
            comparison.add(view)
            slot, count = count, count + 1
        ids.append(-1 if slot is None else slot)
    return np.array(ids)


def rows_of(title: str, drive: Drive) -> list[list[str]]:
    scenes = drive.scenes
    assert scenes.clouds is not None
    odometry = add_odometry_errors(scenes.true_poses(), scenes.seconds, DRIFT)
    judge, builder = ViewJudge(scenes.true_poses(), scenes.seconds), ViewMatcher()
    views = [builder.view(scenes.clouds[index]) for index in range(len(scenes))]
    rows = []
    for name, build in BELIEFS.items():
        started = time.process_time()
        report = judge.judge(match_with(build, views, odometry))
        taken = (time.process_time() - started) / len(views)
        shares = (report.accuracy, report.loop_recall, report.loop_precision)
        cells = ["" if share is None else f"{100 * share:.1f}" for share in shares]
        rows.append([title, name, *cells, f"{1e3 * taken:.0f}"])
        print(*rows[-1], flush=True)
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true", help="put the table into the docs")
    arguments = parser.parse_args()
    drives = [
        (f"recorded {name}", open_drive(data_folder() / "recordings" / f"{name}.npz"))
        for name in WORLDS
    ]
    drives += [(f"{world} {seed}", open_made(world, seed)) for world, seed in MADE]
    text = table(HEAD, [row for title, drive in drives for row in rows_of(title, drive)])
    print(text)
    if arguments.write:
        write_between(PAGE, "place beliefs", text)


if __name__ == "__main__":
    main()
