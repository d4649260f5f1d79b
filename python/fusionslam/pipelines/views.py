# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Run a matcher over a whole scene set, scan after scan, and sweep its threshold."""

import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from fusionslam.base.arrays import Floats
from fusionslam.base.csv_files import write_csv
from fusionslam.base.progress import Progress, reported
from fusionslam.descriptors import DESCRIPTORS, DescriptorConfig, needs_up
from fusionslam.errors import ConfigError, DataError, ShapeError
from fusionslam.evaluation import ViewJudge, ViewRun
from fusionslam.evaluation.views.curve import THRESHOLDS, ViewCurve, sweep_views
from fusionslam.geometry.odometry_noise import DRIFT, add_odometry_errors
from fusionslam.geometry.trajectory import ground_poses
from fusionslam.sensors.frame import Cloud
from fusionslam.views.comparison import Comparison, View
from fusionslam.views.match import NO_VIEW, ViewMatch, ViewStats
from fusionslam.views.matcher import ViewMatcher
from fusionslam.views.recognisers import ViewMatcherConfig, scene_config
from fusionslam.views.scene_set import SceneSet
from fusionslam.views.two_stage_comparison import TWO_STAGES

# Thresholds for alignments, which take too long for a hundred runs.
_PROBABILITIES = (0.0, 0.5, 0.7, 0.8, 0.85, 0.9, 0.93, 0.96, 0.98, 0.99, 1.0)
OdometryKind = Literal["recorded", "drift", "none"]
"""Odometry by which views of a scene set can be weighed."""
COLUMNS = ("scan", "stamp_ns", "id", "similarity", "is_new", "matched", "x", "y", "yaw", "reason")


@dataclass(frozen=True, eq=False)
class MatchRun:
    """The matches of all scans of a set.

    Attributes:
        scenes: the set.
        matches: one per scan.
        stats: statistics of the matcher at the end.
        threshold: similarity from which scans match.
        build_seconds, match_seconds: float64 (n,), time to build the view of a scan and to match
            it.
        follows_odometry: whether stored views were weighed by odometry.
    """

    scenes: SceneSet
    matches: Sequence[ViewMatch]
    stats: ViewStats
    threshold: float
    build_seconds: NDArray[np.float64]
    match_seconds: NDArray[np.float64]
    follows_odometry: bool = False

    @property
    def ids(self) -> NDArray[np.int64]:
        """int64 (n,), -1 for scans without anything to recognise."""
        return np.array([match.id for match in self.matches], np.int64)

    @property
    def similarities(self) -> NDArray[np.float64]:
        """float64 (n,), similarities to the best stored view."""
        return np.array([match.similarity for match in self.matches], np.float64)

    def with_truth(self, method: str, config: Mapping[str, Any] | None = None) -> ViewRun:
        """Return the run with ground truth. Raises DataError if the set has no true poses.

        Args:
            method: name of the method that gave the ids, for tables.
            config: its configuration.
        """
        clouds, compared = self.scenes.clouds, self.similarities > 0
        rows = {int(number): row for row, number in enumerate(self.scenes.numbers)}
        belief: dict[str, Any] = {}  # what scans and odometry said together
        if self.follows_odometry:
            shares = np.array([_split_belief(match) for match in self.matches]).reshape(-1, 2)
            ambiguous = [(row, one) for row, one in enumerate(self.matches) if one.is_ambiguous]
            belief = {"known": shares[:, 0], "others": shares[:, 1]}
            belief["held_back"] = [[row, match.reason] for row, match in ambiguous]
        return ViewRun(
            world=self.scenes.name,
            method=method,
            ids=self.ids,
            poses=self.scenes.true_poses(),
            stamps=self.scenes.seconds,
            numbers=self.scenes.numbers,
            similarities=np.where(compared, self.similarities, np.nan),
            threshold=self.threshold,
            build_seconds=self.build_seconds,
            match_seconds=self.match_seconds,
            bytes_per_view=self.stats.bytes_per_view,
            **belief,
            config=dict(config or {}),
            clouds=None if clouds is None else lambda number: clouds[rows[number]],
        )

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write a CSV with one line per scan and the numbers of the scans. Raises DataError."""
        numbers, rows = self.scenes.numbers, []
        for index, match in enumerate(self.matches):
            pose = [f"{value:.6g}" for value in match.relative_pose or ()] or ["", "", ""]
            matched = "" if match.matched is None else numbers[match.matched]
            scan = [numbers[index], self.scenes.stamps_ns[index], match.id]
            found = [f"{match.similarity:.9g}", int(match.is_new), matched]
            rows.append([*scan, *found, *pose, match.reason])
        write_csv(Path(path), COLUMNS, rows)


def _split_belief(match: ViewMatch) -> tuple[float, float]:
    """Probabilities of the most probable place, together with views beside it, and of others."""
    shares = [share for _, share in match.candidates]
    if match.is_new or match.is_ambiguous or match.id == NO_VIEW:
        known = max([match.similarity * match.is_ambiguous, *shares], default=0.0)
    else:
        known = match.similarity
    return known, 0.0 if match.by_odometry else min(max(sum(shares) - known, 0.0), 1 - known)


def run_views(
    scenes: SceneSet,
    matcher: ViewMatcher,
    progress: Progress | None = None,
    *,
    odometry: Floats | None = None,
) -> MatchRun:
    """Pass every scan of a set to a matcher.

    Args:
        scenes: a set with the views that the matcher compares, or clouds to make them from.
        matcher: new or resumed.
        progress: called with (scans done, total scans).
        odometry: float64 (n, 4, 4), odom_from_robot of each scan, by which stored views are
            weighed; None to compare single scans.

    Raises:
        DataError: the set lacks the views to compare, or a scan cannot be compared; the message
            names it. ShapeError: another number of poses.
    """
    if odometry is not None and np.shape(odometry) != (len(scenes), 4, 4):
        raise ShapeError(
            f"odometry: {np.shape(odometry)}, expected a pose a scan, ({len(scenes)}, 4, 4)"
        )
    poses = [None] * len(scenes) if odometry is None else odometry
    matches, seconds = [], np.zeros((2, len(scenes)))
    built = reported(_build_views(scenes, matcher, seconds[0]), progress, len(scenes))
    for index, view in enumerate(built):
        start = time.perf_counter()
        matches.append(matcher.process(view, odometry=poses[index]))
        seconds[1, index] = time.perf_counter() - start
    follows = odometry is not None
    return MatchRun(
        scenes, matches, matcher.stats, matcher.threshold, seconds[0], seconds[1], follows
    )


def odometry_of(
    scenes: SceneSet, matcher: ViewMatcher, kind: OdometryKind | None = None
) -> Floats | None:
    """Odometry of a set for ``run_views``.

    Args:
        scenes: the set.
        matcher: what will match it.
        kind: "none", "recorded", or "drift", which is simulated from the true poses: 2 % too long,
            turns 1 % too wide; None: recorded odometry, where it is there and the matcher can use
            it.

    Returns:
        float64 (n, 4, 4), NaN where it is unknown; None for none.

    Raises:
        DataError: the set has no odometry (code "no-odometry"), or no true poses.
        ConfigError: the matcher cannot use it (code "no-filter").
    """
    usable = matcher.config.odometry and matcher.can_follow_odometry
    if kind is None:
        kind = "recorded" if usable and scenes.odometry is not None else "none"
    if kind == "none":
        return None
    if not usable:
        raise ConfigError(
            f"odometry {kind}, but views are compared by {matcher.comparison.kind}: expected "
            "alignment, and views.odometry=true",
            code="no-filter",
            fields=("odometry",),
        )
    if kind == "drift":
        places = add_odometry_errors(scenes.true_poses(), scenes.seconds, DRIFT)
    elif scenes.odometry is None:
        raise DataError(
            f"{scenes.name} has no odometry: --odometry drift simulates it from true poses",
            code="no-odometry",
        )
    else:
        places = scenes.odometry
    return ground_poses(*places.T)


def views_of(
    scenes: SceneSet, matcher: ViewMatcher, progress: Progress | None = None
) -> list[View]:
    """Build the view of each scan once, for many runs. Raises as ``run_views``."""
    built = _build_views(scenes, matcher, np.zeros(len(scenes)))
    return list(reported(built, progress, len(scenes)))


def _build_views(
    scenes: SceneSet, matcher: ViewMatcher, seconds: NDArray[np.float64]
) -> Iterator[View]:
    item_at = _items(scenes, matcher)
    for index in range(len(scenes)):
        start = time.perf_counter()
        try:
            view = matcher.view(item_at(index))
        except DataError as error:
            raise DataError(
                f"{scenes.name}, scan {scenes.numbers[index]}: {error}",
                code=error.code,
                fields=error.fields,
            ) from error
        seconds[index] = time.perf_counter() - start
        yield view


def _items(scenes: SceneSet, matcher: ViewMatcher) -> Callable[[int], Any]:
    """Return a function from scan to matcher input: the stored view if it fits, else the cloud."""
    kind = matcher.comparison.kind
    by_turn = kind.endswith("alignment") or (
        kind in DESCRIPTORS and needs_up(kind, matcher.descriptor_config)
    )
    if by_turn and scenes.frame == "odometry":
        raise DataError(
            f"{scenes.name}: {kind} needs clouds in the robot's frame, these are in that of "
            "odometry: record them in frame robot, or compare objects (views.method=objects)",
            code="wrong-frame",
            fields=(scenes.frame,),
        )
    if kind in ("objects", "alignment") and scenes.fits(scene_config(matcher.config)):
        return lambda index: (scenes.scenes or ())[index]
    if kind in scenes.features:
        rows = scenes.features[kind]
        nothing = Cloud(np.empty((0, 3), np.float32), np.empty((0, 3), np.uint8))
        return lambda index: nothing if np.isnan(rows[index]).any() else rows[index]
    if scenes.clouds is None:
        raise DataError(
            f"{scenes.name} holds no clouds, and {_explain_lack(scenes, kind)}",
            code="no-clouds",
            fields=(kind,),
        )
    return scenes.clouds.__getitem__


def _explain_lack(scenes: SceneSet, kind: str) -> str:
    """Say what a set without clouds would have to hold instead."""
    if kind in DESCRIPTORS:
        return f"no {kind}: record it with --features {kind}"
    if kind.startswith(TWO_STAGES):
        return "two stages need them: record it without --only-scenes"
    if kind not in ("objects", "alignment"):
        return f"{kind} needs them: record it without --only-scenes"
    other = "scenes of another configuration" if scenes.scenes else "no scenes"
    return f"{other}: record it with these views.scene, or without --only-scenes"


def sweep_thresholds(
    scenes: SceneSet,
    config: ViewMatcherConfig,
    *,
    descriptors: DescriptorConfig | None = None,
    rule: str = "paper",
    comparison: Callable[[], Comparison] | None = None,
    progress: Progress | None = None,
) -> ViewCurve:
    """Evaluate a run with each of a hundred thresholds; the views are built once.

    Object scenes are tried from 0 to 1 in steps of 0.01 (Stastny 2022, 5.4). Other similarities lie
    closer together: their thresholds are quantiles of the similarities to the best earlier scan.

    Args:
        scenes: with ground-truth poses.
        config: of the matcher, whose threshold is not used.
        descriptors: how clouds are described, if the method is a descriptor.
        rule: name of the evaluation rule.
        comparison: makes a new comparison for each run; None for the configured one.
        progress: called with (runs done, total runs).

    Raises:
        DataError: the set has no poses, or lacks the views to compare.
    """
    judge = ViewJudge(scenes.true_poses(), scenes.seconds, rule=rule)

    def matcher(threshold: float) -> ViewMatcher:
        made = comparison() if comparison is not None else None
        changed = config.model_copy(update={"threshold": threshold})
        return ViewMatcher(changed, descriptors=descriptors, comparison=made)

    first = matcher(1.0)
    views = views_of(scenes, first)
    kind = first.comparison.kind.removeprefix(TWO_STAGES)
    known = {"objects": THRESHOLDS, "alignment": _PROBABILITIES}.get(kind)
    thresholds = list(known or ())
    if known is None:  # that divide the best similarities evenly
        found = [first.process(view) for view in views]
        best = [match.similarity for match in found if match.id >= 0 and match.similarity > 0]
        shares = np.linspace(0, 1, len(THRESHOLDS))
        thresholds = np.unique(np.quantile(np.array(best or [0.0]), shares)).tolist()
    done = 0

    def ids(threshold: float) -> NDArray[np.int64]:
        nonlocal done
        one = matcher(threshold)
        found = np.array([one.process(view).id for view in views], np.int64)
        done += 1
        if progress is not None:
            progress(done, len(thresholds))
        return found

    return sweep_views(judge, ids, thresholds)
