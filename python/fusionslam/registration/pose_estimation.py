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

import numpy as np

from fusionslam._core import count_overlap, refine_pose
from fusionslam.base.argument_types import checked
from fusionslam.base.arrays import Floats, Matrix, Points, read_numbers
from fusionslam.errors import ConfigError, DataError, ShapeError
from fusionslam.geometry.rigid import is_rigid
from fusionslam.geometry.se3 import carry_covariance, inverse
from fusionslam.registration.birds_eye import (
    Hypothesis,
    SearchImage,
    find_height,
    find_hypotheses,
)
from fusionslam.registration.clouds import PreparedCloud, SearchedCloud
from fusionslam.registration.colors import ColorDifference, compare_colors
from fusionslam.registration.config import RegistrationConfig
from fusionslam.registration.map_extra import FEWEST_FEATURES, can_search, search_pose
from fusionslam.registration.planar import register_planar
from fusionslam.registration.probability import SmallView, pose_probability
from fusionslam.registration.result import Refusal, Registration
from fusionslam.registration.uncertainty import motion_covariance, pose_covariance, weak_directions
from fusionslam.sensors.frame import Cloud

_FEWEST_POINTS = 20
"""Below, normals of points are no more than guesses."""
_HIDDEN_WEIGHT = 0.25
"""Of points that the other sensor cannot have seen: right poses have fewer of them."""
_LEAST = 0.5
"""Less probable poses are refused, unless it is configured."""
_MOST_COMPARED = 2000
"""Points whose colours are compared; more cost time alone."""


@checked
def register(
    source: Cloud | Points | PreparedCloud,
    target: Cloud | Points | PreparedCloud,
    guess: Matrix | None = None,
    *,
    search: bool = True,
    thorough: bool = True,
    leveled: bool = False,
    config: RegistrationConfig | None = None,
) -> Registration:
    """Find the pose of a cloud in the frame of another one.

    Method "global": a guess is refined by GICP; without one, or if its overlap is too small, a pose
    is searched and refined. Where up is known in both (``gravity``) the search correlates images
    from above (``search_poses``); else KISS-Matcher matches features, and both clouds are
    tried as if taken from one pose, as views that look alike may be. Where KISS-Matcher is not
    installed, as on Python 3.13 and later, a guess is judged alone. Method "planar", for robots on
    a floor: range images are aligned in x, y and yaw. Equal input gives equal bits.

    Args:
        source, target: a Cloud or float32 (N, 3), metres, in the frame of the sensor; or a
            PreparedCloud, of which configurations must be equal. For "planar" with colours, in the
            frame of a robot on a floor.
        guess: float64 (4, 4), target_from_source, such as a turn about z from a descriptor; up to
            some metres and degrees off. "planar" uses its turn alone.
        search: whether a pose is searched if the guess is refused.
        thorough: without ``gravity``, whether a search that fails is repeated with the features of
            more points, which takes some five times as long.
        leveled: whether the guess is one of ``search_poses``, between the levelled clouds.
        config: that of prepared clouds if None.

    Returns:
        The pose with its covariance, or the reason why there is none.

    Raises:
        FusionSlamError: without gravity and guess, KISS-Matcher is not installed (code
            "missing-extra"), has no package for this Python ("no-package") or is not that of PyPI
            ("other-package").
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
        if start is not None and not leveled:
            start = other.level_from_cloud @ start @ inverse(one.level_from_cloud)
        result = _register_globally(one, other, start, search, thorough, config)
        result = _tilted_back(result, one, other)
    else:
        result = register_planar(one.scene, other.scene, start, config)
    if result.target_from_source is not None and result.covariance is not None:
        covariance = result.covariance.copy()
        if one.moved is not None:
            covariance += motion_covariance(one.moved, one.points)
        if other.moved is not None:
            back = inverse(result.target_from_source)
            covariance += carry_covariance(back, motion_covariance(other.moved, other.points))
        result = replace(result, covariance=covariance)
    return replace(result, seconds=time.perf_counter() - started)


def _tilted_back(
    leveled: Registration, source: PreparedCloud, target: PreparedCloud
) -> Registration:
    """Return the pose of levelled clouds as that of the clouds that were given."""
    if leveled.estimate is None or (source.level is None and target.level is None):
        return leveled
    there, back = source.level_from_cloud, inverse(target.level_from_cloud)
    pose, covariance = leveled.target_from_source, leveled.covariance
    return replace(
        leveled,
        estimate=back @ leveled.estimate @ there,
        target_from_source=None if pose is None else back @ pose @ there,
        covariance=None if covariance is None else carry_covariance(inverse(there), covariance),
        degenerate=leveled.degenerate @ there[:3, :3],
    )


@checked
def search_poses(
    source: PreparedCloud, target: PreparedCloud | SearchImage, most: int = 1
) -> list[Hypothesis]:
    """Correlate two clouds' images from above: poses to be refined, the best first.

    The turned images of the source are kept, so that one source with many targets is cheap: some
    4 ms, and 1 ms a target.

    Args:
        source: prepared with ``gravity``.
        target: prepared like it, or the ``search_image`` that is kept of it.
        most: number of poses; their turns differ by 24 degrees or more.

    Returns:
        Poses of the levelled clouds and their correlations; none if a cloud has nothing above the
        ground nearby.
    """
    image = target if isinstance(target, SearchImage) else target.search_image
    cell = source.config.search_cell
    found = find_hypotheses(source.turned_images, image.spectra, cell, most)
    rise = image.ground_level - source.search_image.ground_level
    for each in found:
        each.pose[2, 3] = rise
    return found


@checked
def compare_images(source: PreparedCloud, image: SearchImage) -> float:
    """Return the largest correlation of two clouds' images from above, coarsely.

    A quarter of the time of ``search_poses``, to choose what that is worth for.
    """
    return find_height(source.coarse_images, image.coarse_spectra)


def _register_globally(
    source: PreparedCloud,
    target: PreparedCloud,
    guess: Matrix | None,
    search: bool,
    thorough: bool,
    config: RegistrationConfig,
) -> Registration:
    fewest = min(len(source), len(target))
    if fewest < _FEWEST_POINTS:
        text = f"{fewest} voxels of {config.voxel:g} m in a cloud, fewer than {_FEWEST_POINTS}"
        return _refused(Refusal("few-points", fewest, text))
    best: _Candidate | None = None
    for candidate in _candidates(source, target, guess, search, thorough, config):
        if best is None or _rank(candidate[0], config) > _rank(best[0], config):
            best = candidate
        if (_misfit(best[0], config) or _doubt(best[0], config)) is None:
            break
    if best is None:
        return _refused(_without_candidate(source, target, config))
    judged, information = best
    reason = _misfit(judged, config)
    if reason is None and (directions := len(judged.degenerate)) >= 2:
        # A single plane, or several in parallel, hold them: that fits everywhere.
        text = (
            f"the clouds can slide on each other in {directions} directions: too little structure"
        )
        reason = Refusal("degenerate", directions, text)
    reason = reason or _doubt(judged, config)
    if reason is not None:
        return replace(judged, reason=reason)
    covariance = pose_covariance(information, judged.degenerate, config)
    return replace(judged, target_from_source=judged.estimate, covariance=covariance)


def _refused(reason: Refusal) -> Registration:
    return Registration(None, None, reason=reason)


def _without_candidate(
    source: PreparedCloud, target: PreparedCloud, config: RegistrationConfig
) -> Refusal:
    if config.gravity:
        return Refusal("no-match", 0, "a cloud shows nothing above the ground nearby")
    features = min(source.searched_clouds[0].features, target.searched_clouds[0].features)
    text = (
        f"{features} points of a cloud have neighbours within {config.search_voxel:g} m, "
        f"fewer than {FEWEST_FEATURES}: too sparse for a search"
    )
    return Refusal("no-features", features, text)


_Candidate = tuple[Registration, Floats]
"""A refined pose, the estimate of what it is judged by, and its information matrix."""


def _rank(judged: Registration, config: RegistrationConfig) -> tuple[bool, float]:
    """Upright poses first, then by probability."""
    return _is_upright(judged, config), judged.probability or 0.0


def _misfit(judged: Registration, config: RegistrationConfig) -> Refusal | None:
    """Return why a pose cannot be right; None if it can."""
    if not _is_upright(judged, config):
        text = f"tilted by {judged.tilt:.1f} deg, more than {config.max_tilt:g}"
        return Refusal("tilted", judged.tilt, text)
    if judged.overlap < config.min_overlap:
        text = f"overlap {judged.overlap:.2f}, less than {config.min_overlap:g}"
        return Refusal("low-overlap", judged.overlap, text)
    return None


def _doubt(judged: Registration, config: RegistrationConfig) -> Refusal | None:
    """Return that a pose is too improbable; None if it is not."""
    least = _LEAST if config.min_probability is None else config.min_probability
    probability = judged.probability or 0.0
    if probability >= least:
        return None
    text = f"probability {probability:.2f}, less than {least:g} (overlap {judged.overlap:.2f})"
    return Refusal("improbable", probability, text)


def _is_upright(judged: Registration, config: RegistrationConfig) -> bool:
    return not config.gravity or judged.tilt <= config.max_tilt


def _candidates(
    source: PreparedCloud,
    target: PreparedCloud,
    guess: Matrix | None,
    search: bool,
    thorough: bool,
    config: RegistrationConfig,
) -> Iterator[_Candidate]:
    """Refined poses, the cheaper first."""

    def refined(start: Matrix, distance: float) -> tuple[Matrix, Floats]:
        found = refine_pose(
            source.moved_points,
            target.refined,
            start,
            distance=distance,
            iterations=config.iterations,
        )
        return found.target_from_source, found.information

    def refined_once(start: Matrix) -> _Candidate:
        pose, information = refined(start, config.distance)
        return _judge(source, target, pose, information, config), information

    def refined_twice(start: Matrix) -> _Candidate:
        near, _ = refined(start, config.guess_distance)
        return refined_once(near)

    if guess is not None:
        yield refined_twice(guess)
        if not (search and (config.gravity or can_search())):
            return
    if config.gravity:
        for found in search_poses(source, target):
            yield refined_twice(found.pose)
        return
    (few, its_few), (dense, its_dense) = zip(
        source.searched_clouds, target.searched_clouds, strict=True
    )
    if min(few.features, its_few.features) < FEWEST_FEATURES:
        return
    yield from map(refined_once, _search(few, its_few, config))
    if guess is None:
        yield refined_twice(np.eye(4))
    if thorough and min(dense.features, its_dense.features) >= FEWEST_FEATURES:
        yield from map(refined_once, _search(dense, its_dense, config))


def _search(one: SearchedCloud, other: SearchedCloud, config: RegistrationConfig) -> list[Matrix]:
    pose = search_pose(one.points, other.points, config.search_voxel)
    return [] if pose is None else [pose]


def _judge(
    source: PreparedCloud,
    target: PreparedCloud,
    pose: Matrix,
    information: Floats,
    config: RegistrationConfig,
) -> Registration:
    """Return what a refined pose is judged by, without a decision."""
    distance = config.overlap_distance
    back = np.linalg.inv(pose).astype(np.float64)
    there, again = (
        _overlap(source, target, pose, distance),
        _overlap(target, source, back, distance),
    )
    overlap, agreeing = min(there[0], again[0]), min(there[1], again[1])
    mean_overlap = (there[0] + again[0]) / 2
    degenerate = weak_directions(information[:3, :3], config.degenerate_ratio)
    colors = _color_difference(source, target, pose, distance)
    is_small_view = source.is_small_view or target.is_small_view
    small = SmallView(agreeing, len(degenerate)) if is_small_view else None
    return Registration(
        None,
        None,
        overlap,
        float(np.degrees(np.arccos(np.clip(pose[2, 2], -1, 1)))),
        degenerate,
        probability=pose_probability(overlap, colors, small, mean_overlap=mean_overlap),
        estimate=pose,
        color_difference=colors,
        agreeing=agreeing,
        mean_overlap=mean_overlap,
    )


def _overlap(
    one: PreparedCloud, other: PreparedCloud, other_from_one: Matrix, distance: float
) -> tuple[float, int]:
    """Share of a cloud's points that another confirms, of those that it could; their number."""
    counts = count_overlap(
        one.above_ground,
        other.above_ground,
        other.ranges,
        other_from_one,
        distance=distance,
        further=other.further,
    )
    against = counts["before"] + _HIDDEN_WEIGHT * (counts["behind"] + counts["open"])
    agreeing = counts["agreeing"]
    return agreeing / max(1.0, agreeing + against), agreeing


def _color_difference(
    source: PreparedCloud, target: PreparedCloud, pose: Matrix, distance: float
) -> ColorDifference | None:
    """Compare the colours of a cloud's points and of their neighbours in the other."""
    if source.colors is None or target.colors is None:
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
    if not isinstance(config, RegistrationConfig | None):
        raise TypeError(f"config: {config!r}, expected a RegistrationConfig")
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
