# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Registers clouds: a guess is refined, or a pose is searched, and it is judged by overlap.

Where the z axes point up, the search is a correlation of images from above; else features are
matched. Their inliers do not tell right poses from wrong ones, and most wrong poses are upside
down: poses are judged by what both clouds show above the ground, and by their tilt.
"""

import time
from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from fusionslam._core import count_overlap
from fusionslam.errors import ConfigError, DataError, ShapeError
from fusionslam.geometry.rigid import is_rigid
from fusionslam.registration.birds_eye import (
    Hypothesis,
    SearchImage,
    coarse,
    find_height,
    find_hypotheses,
)
from fusionslam.registration.clouds import PreparedCloud
from fusionslam.registration.colors import ColorDifference, compare_colors
from fusionslam.registration.config import RegistrationConfig
from fusionslam.registration.map_extra import (
    FEWEST_FEATURES,
    FEWEST_POINTS,
    can_search,
    refine,
    search_pose,
)
from fusionslam.registration.planar import register_planar
from fusionslam.registration.probability import pose_probability
from fusionslam.registration.result import Refusal, Registration
from fusionslam.registration.uncertainty import pose_uncertainty
from fusionslam.sensors.frame import Cloud
from fusionslam.storage.arrays import Floats, Matrix, Points, read_numbers

_HIDDEN_WEIGHT = 0.25
"""Of points that the other sensor cannot have seen: right poses have fewer of them."""
_LEAST = 0.5
"""Less probable poses are refused, unless it is configured."""
_MOST_COMPARED = 2000
"""Points whose colours are compared; more cost time alone."""


def register(
    source: Cloud | Points | PreparedCloud,
    target: Cloud | Points | PreparedCloud,
    guess: Matrix | None = None,
    *,
    search: bool = True,
    config: RegistrationConfig | None = None,
) -> Registration:
    """Find the pose of a cloud in the frame of another one.

    Method "global": a guess is refined by GICP; without one, or if its overlap is too small, a pose
    is searched and refined. Where z points up in both clouds (``gravity``) the search correlates
    images from above (``search_poses``); else KISS-Matcher matches features, and where it is not
    installed, as on Python 3.13 and later, a guess is judged alone. Method "planar", for robots on
    a floor: range images are aligned in x, y and yaw. Equal input gives equal bits.

    Args:
        source, target: a Cloud or float32 (N, 3), metres, in the frame of the sensor; or a
            PreparedCloud, of which configurations must be equal. For "planar" with colours, in the
            frame of a robot on a floor.
        guess: float64 (4, 4), target_from_source, such as a turn about z from a descriptor; up to
            some metres and degrees off. "planar" uses its turn alone.
        search: whether a pose is searched if the guess is refused.
        config: that of prepared clouds if None.

    Returns:
        The pose with its covariance, or the reason why there is none.

    Raises:
        FusionSlamError: the extra ``map`` is not installed (code "missing-extra"); without gravity
            and guess, KISS-Matcher has no package for this Python ("no-package") or is not that of
            PyPI ("other-package"). "planar" needs neither.
        ShapeError: not a cloud, or a guess of another shape.
        DataError: NaN or infinity in a point; no colours ("planar"); a guess that is no rigid
            motion.
        ConfigError: clouds prepared with different configurations; neither guess nor search.
    """
    if guess is None and not search:
        raise ConfigError("there is neither a guess nor a search", code="choice")
    started = time.perf_counter()
    config = _config_of(config, source, target)
    start = None if guess is None else _check_rigid(guess)
    one, other = _prepared(source, config), _prepared(target, config)
    if one.scene is None or other.scene is None:
        result = _register_globally(one, other, start, search, config)
        colors = _color_difference(one, other, result.estimate, config.overlap_distance)
        result = replace(result, color_difference=colors)
        if result.estimate is not None:
            result = _weigh(result, pose_probability(result.overlap, colors), config)
    else:
        result = register_planar(one.scene, other.scene, start, config)
    return replace(result, seconds=time.perf_counter() - started)


def search_poses(
    source: PreparedCloud, target: PreparedCloud | SearchImage, most: int = 1
) -> list[Hypothesis]:
    """Correlate two clouds' images from above: poses to be refined, the best first.

    The turned images of the source are kept, so that one source with many targets is cheap: some
    10 ms, and 2 ms a target.

    Args:
        source: prepared with ``gravity``.
        target: prepared like it, or the ``search_image`` that is kept of it.
        most: number of poses; their turns differ by 24 degrees or more.

    Returns:
        Poses and their correlations; none if a cloud has nothing above the ground nearby.
    """
    image = target if isinstance(target, SearchImage) else target.search_image
    cell = source.config.search_cell
    found = find_hypotheses(source.turned_images, image.spectra, cell, most)
    rise = image.ground_level - source.search_image.ground_level
    for each in found:
        each.pose[2, 3] = rise
    return found


def compare_images(source: PreparedCloud, image: SearchImage) -> float:
    """Return the largest correlation of two clouds' images from above, coarsely.

    A quarter of the time of ``search_poses``, to choose what that is worth for.
    """
    return find_height(source.coarse_images, coarse(image.spectra))


def _register_globally(
    source: PreparedCloud,
    target: PreparedCloud,
    guess: Matrix | None,
    search: bool,
    config: RegistrationConfig,
) -> Registration:
    fewest = min(len(source), len(target))
    if fewest < FEWEST_POINTS:
        text = f"{fewest} voxels of {config.voxel:g} m in a cloud, fewer than {FEWEST_POINTS}"
        return _refused(Refusal("few-points", fewest, text))
    best: _Candidate | None = None
    for candidate in _candidates(source, target, guess, search, config):
        if best is None or candidate.rank(config) > best.rank(config):
            best = candidate
        if best.refusal(config) is None and pose_probability(best.overlap, None) >= _LEAST:
            break
    if best is None:
        return _refused(_without_candidate(source, target, config))
    covariance, degenerate = pose_uncertainty(best.information, config)
    judged = Registration(None, None, best.overlap, best.tilt, degenerate, estimate=best.pose)
    reason = best.refusal(config) or _too_degenerate(len(degenerate))
    if reason is not None:
        return replace(judged, reason=reason)
    return replace(judged, target_from_source=best.pose, covariance=covariance)


def _weigh(result: Registration, probability: float, config: RegistrationConfig) -> Registration:
    """Add the probability of the estimate, and refuse an improbable one."""
    result = replace(result, probability=probability)
    least = _LEAST if config.min_probability is None else config.min_probability
    if result.reason is not None or probability >= least:
        return result
    text = f"probability {probability:.2f}, less than {least:g} (overlap {result.overlap:.2f})"
    reason = Refusal("improbable", probability, text)
    return replace(result, target_from_source=None, covariance=None, reason=reason)


def _refused(reason: Refusal) -> Registration:
    return Registration(None, None, reason=reason)


def _too_degenerate(directions: int) -> Refusal | None:
    """Refuse what a single plane, or several in parallel, hold: it fits everywhere."""
    if directions < 2:
        return None
    text = f"the clouds can slide on each other in {directions} directions: too little structure"
    return Refusal("degenerate", directions, text)


def _without_candidate(
    source: PreparedCloud, target: PreparedCloud, config: RegistrationConfig
) -> Refusal:
    if config.gravity:
        return Refusal("no-match", 0, "a cloud shows nothing above the ground nearby")
    features = min(source.features, target.features)
    if features < FEWEST_FEATURES:
        text = (
            f"{features} points of a cloud have neighbours within {config.search_voxel:g} m, "
            f"fewer than {FEWEST_FEATURES}: too sparse for a search"
        )
        return Refusal("no-features", features, text)
    return Refusal("no-match", 0, "fewer than three features of the clouds match")


class _Candidate(NamedTuple):
    """A refined pose, its information matrix, and what it is judged by."""

    pose: Matrix
    information: Floats
    overlap: float
    tilt: float

    def rank(self, config: RegistrationConfig) -> tuple[bool, float]:
        """Upright poses first, then by overlap."""
        return self._upright(config), self.overlap

    def refusal(self, config: RegistrationConfig) -> Refusal | None:
        """Return why the pose is refused; None if it is not."""
        if not self._upright(config):
            text = f"tilted by {self.tilt:.1f} deg, more than {config.max_tilt:g}"
            return Refusal("tilted", self.tilt, text)
        if self.overlap < config.min_overlap:
            text = f"overlap {self.overlap:.2f}, less than {config.min_overlap:g}"
            return Refusal("low-overlap", self.overlap, text)
        return None

    def _upright(self, config: RegistrationConfig) -> bool:
        return not config.gravity or self.tilt <= config.max_tilt


def _candidates(
    source: PreparedCloud,
    target: PreparedCloud,
    guess: Matrix | None,
    search: bool,
    config: RegistrationConfig,
) -> Iterator[_Candidate]:
    """Refined poses, the cheaper first."""

    def refined(start: Matrix, distance: float) -> tuple[Matrix, Floats]:
        return refine(source.refined, target.refined, start, distance, config.iterations)

    def refined_twice(start: Matrix) -> _Candidate:
        near, _ = refined(start, config.guess_distance)
        return _judged(source, target, *refined(near, config.distance), config)

    if guess is not None:
        yield refined_twice(guess)
        if not (search and (config.gravity or can_search())):
            return
    if config.gravity:
        for found in search_poses(source, target):
            yield refined_twice(found.pose)
    elif min(source.features, target.features) >= FEWEST_FEATURES:
        pose = search_pose(source.search_points, target.search_points, config.search_voxel)
        if pose is not None:
            yield _judged(source, target, *refined(pose, config.distance), config)


def _judged(
    source: PreparedCloud,
    target: PreparedCloud,
    pose: Matrix,
    information: Floats,
    config: RegistrationConfig,
) -> _Candidate:
    tilt = float(np.degrees(np.arccos(np.clip(pose[2, 2], -1, 1))))
    distance = config.overlap_distance
    there = _overlap(source, target, pose, distance)
    back = _overlap(target, source, np.linalg.inv(pose).astype(np.float64), distance)
    return _Candidate(pose, information, min(there, back), tilt)


def _overlap(
    one: PreparedCloud, other: PreparedCloud, other_from_one: Matrix, distance: float
) -> float:
    """Share of a cloud's points that the other cloud confirms, of those that it could."""
    counts = count_overlap(
        one.above_ground, other.above_ground, other.ranges, other_from_one, distance=distance
    )
    against = counts["before"] + _HIDDEN_WEIGHT * (counts["behind"] + counts["open"])
    return counts["agreeing"] / max(1.0, counts["agreeing"] + against)


def _color_difference(
    source: PreparedCloud, target: PreparedCloud, pose: Matrix | None, distance: float
) -> ColorDifference | None:
    """Compare the colours of a cloud's points and of their neighbours in the other."""
    if pose is None or source.colors is None or target.colors is None:
        return None
    points, colors = source.colored_above
    some = slice(None, None, 1 + len(points) // _MOST_COMPARED)
    places = points[some] @ pose[:3, :3].T + pose[:3, 3]
    apart, nearest = target.colored_tree.query(places, distance_upper_bound=distance)
    near = np.isfinite(apart)
    return compare_colors(colors[some][near], target.colored_above[1][nearest[near]])


def _config_of(
    config: RegistrationConfig | None, *clouds: Cloud | Points | PreparedCloud
) -> RegistrationConfig:
    for each in clouds:
        if not isinstance(each, PreparedCloud):
            continue
        if config is not None and config != each.config:
            raise ConfigError("the clouds were prepared with different configurations")
        config = each.config
    return config or RegistrationConfig()


def _prepared(cloud: Cloud | Points | PreparedCloud, config: RegistrationConfig) -> PreparedCloud:
    return cloud if isinstance(cloud, PreparedCloud) else PreparedCloud(cloud, config)


def _check_rigid(guess: Matrix) -> Matrix:
    pose = read_numbers("guess", guess, "float64 (4, 4)")
    if pose.shape != (4, 4):
        raise ShapeError(f"guess has shape {pose.shape}, expected (4, 4)")
    if not is_rigid(pose, 1e-4):
        raise DataError(f"guess is no rigid motion: {pose.tolist()}")
    return pose
