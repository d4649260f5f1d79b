# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The probability of a registered pose grows with its overlap and falls with its colours."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

import fusionslam.registration.probability as probability
from benchmarks.accuracy.registration_probability import (
    CIRCLES,
    FITTED_TO,
    KINDS,
    MODEL,
    MODELS,
    REAL,
    REAL_FITTED,
    RECORDED,
    REPORTED,
    Poses,
    calibration_row,
    clouds_of,
    fit,
    model_yaml,
    predict,
)
from clouds import painted_blocks, scan_blocks
from fusionslam.base.arrays import Points
from fusionslam.registration import ColorDifference, PreparedCloud, register
from fusionslam.registration.probability import SmallView, pose_probability
from rows import rows
from streets import at

OVERLAPS = np.linspace(0, 1, 21)


def colors(ratio: float) -> ColorDifference:
    return ColorDifference(10 * ratio, 10.0, 100)


def test_it_is_the_logistic_function_of_the_fitted_model(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    fitted = {
        "plain": {"intercept": -7.0, "mean_overlap": 10.0},
        "colored": {"intercept": -4.0, "overlap": 10.0, "color_ratio": -5.0},
        "small": {"intercept": -9.0, "overlap": 4.0, "log_agreeing": 2.0, "degenerate": -1.5},
    }
    path = tmp_path / "probability.yaml"
    path.write_text(yaml.safe_dump(fitted), encoding="utf-8")
    monkeypatch.setattr(probability, "_FITTED", path)
    probability._models.cache_clear()
    try:
        assert pose_probability(0.7, None) == pytest.approx(0.5)
        assert pose_probability(0.9, None) == pytest.approx(1 / (1 + np.exp(-2)))
        assert pose_probability(0.7, None, mean_overlap=0.9) == pose_probability(0.9, None)
        assert pose_probability(0.7, colors(0.4)) == pytest.approx(1 / (1 + np.exp(-1)))
        small = SmallView(agreeing=100, degenerate=1)
        score = -9 + 4 * 0.7 + 2 * np.log(100) - 1.5
        assert pose_probability(0.7, None, small) == pytest.approx(1 / (1 + np.exp(-score)))
        of_one = pose_probability(0.7, colors(0.4), small, mean_overlap=0.9)
        assert of_one == pose_probability(0.7, colors(0.4))
        assert pose_probability(0.7, None, small, mean_overlap=0.9) == pytest.approx(
            1 / (1 + np.exp(-score))
        )
        nothing = pose_probability(0.0, None, SmallView(0, 0))
        assert nothing == pytest.approx(1 / (1 + np.exp(9)))
    finally:
        probability._models.cache_clear()


def test_the_fit_finds_the_model_that_made_the_poses() -> None:
    rng = np.random.default_rng(1)
    features = rng.uniform(0, 1, (20000, 2))
    right = rng.uniform(size=20000) < 1 / (1 + np.exp(1 - features @ [8, -5]))
    assert fit(features, right, np.ones(20000)) == pytest.approx([-1, 8, -5], rel=0.1)


def test_weights_of_poses_are_as_if_they_were_there_more_often() -> None:
    rng = np.random.default_rng(2)
    features = rng.normal(size=(400, 1))
    right = rng.uniform(size=400) < 0.5 + 0.3 * np.tanh(features[:, 0])
    weights = np.where(np.arange(400) < 100, 3.0, 1.0)
    rows = np.repeat(np.arange(400), weights.astype(int))
    repeated = fit(features[rows], right[rows], np.ones(len(rows)))
    assert fit(features, right, weights) == pytest.approx(repeated, rel=0.05)


def test_the_stored_model_is_as_the_benchmark_writes_it() -> None:
    text = MODEL.read_text(encoding="utf-8")
    stored = yaml.safe_load(text)
    assert {kind: tuple(each)[1:] for kind, each in stored.items()} == MODELS
    assert model_yaml({kind: np.array([*each.values()]) for kind, each in stored.items()}) == text


def test_the_benchmark_predicts_as_the_package_does() -> None:
    stored = yaml.safe_load(MODEL.read_text(encoding="utf-8"))
    models = {kind: np.array([*each.values()]) for kind, each in stored.items()}
    features = np.array([(0.8, 0.85, 0.5, np.log(200), 1), (0.7, 0.75, np.nan, np.log(50), 0)])
    poses = Poses(features, np.zeros((2, 2)), np.ones(2))
    small = SmallView(200, 1), SmallView(50, 0)
    by_small = [pose_probability(0.8, None, small[0]), pose_probability(0.7, None, small[1])]
    by_color = pose_probability(0.8, colors(0.5))
    by_mean = [pose_probability(least, None, mean_overlap=least + 0.05) for least in (0.8, 0.7)]
    expected: dict[tuple[str, ...], list[float]] = {
        ("plain",): by_mean,
        ("small",): by_small,
        ("colored", "plain"): [by_color, by_mean[1]],
        ("colored", "small"): [by_color, by_small[1]],
    }
    for kinds, values in expected.items():
        assert predict(models, poses, kinds) == pytest.approx(values)


def test_the_table_counts_what_was_right_of_what_was_said() -> None:
    errors = np.array([(0.4, 0.9), (0.9, 0.2), (1.2, 1.5), (0.1, 2.5), (0.3, 0.3)])
    poses = Poses(np.zeros((5, 5)), errors, np.ones(5))
    row = calibration_row(np.array([0.01, 0.3, 0.3, 0.97, 0.995]), poses)
    assert row[:4] == ["5", "40.0%", "60.0%", "80.0%"]
    assert row[4:9] == ["1.00 (1)", "0.50 (2)", "none", "0.00 (1)", "1.00 (1)"]
    assert row[9:] == ["0.33", "1 of 2"]


@pytest.mark.nightly
def test_scans_of_made_rooms_lie_where_their_poses_say() -> None:
    pytest.importorskip("embreex", reason="the simulator is an extra")
    for (cloud, pose), _ in zip(clouds_of(1, "house"), range(3), strict=False):
        azimuths = np.arctan2(cloud.points[:, 1], cloud.points[:, 0])
        assert 0.5 < np.abs(azimuths).max() < 0.56
        world = cloud.points @ pose[:3, :3].T + pose[:3, 3]
        low = np.sort(world[:, 2])[: len(world) // 20]
        assert np.median(low) == pytest.approx(0, abs=0.05)  # the floor


def test_what_is_reported_was_not_fitted() -> None:
    sources = {source for shown, _ in KINDS.values() for source in shown}
    real = {REAL + name for names in REAL_FITTED.values() for name in names}
    assert sources == set(REPORTED)
    assert {source for source in sources if not source.startswith(REAL)} == (
        {*FITTED_TO, *RECORDED} - real
    )
    assert set(CIRCLES) < sources and real < FITTED_TO.keys()
    assert not any(
        set(REPORTED.get(source, ())) & set(seeds) for source, seeds in FITTED_TO.items()
    )


def test_poses_are_more_probable_with_more_overlap_and_points_and_less_if_they_can_slide() -> None:
    series = [[(each, known) for each in OVERLAPS] for known in (None, colors(0.4), colors(0.9))]
    series += [[(each, None, SmallView(300, 0)) for each in OVERLAPS]]
    series += [[(0.9, None, SmallView(count, 0)) for count in (10, 100, 1000)]]
    series += [[(0.9, None, SmallView(300, count)) for count in (2, 1, 0)]]
    # Colours that differ less.
    series += [[(overlap, colors(each)) for each in OVERLAPS[::-1]] for overlap in (0.6, 0.8)]
    for row in series:
        assert (np.diff([pose_probability(*values) for values in row]) > 0).all()


def test_a_few_surfaces_of_small_views_fit_by_chance() -> None:
    assert pose_probability(0.9, None) > 0.99
    for small in (SmallView(100, 0), SmallView(300, 1)):
        assert pose_probability(0.9, None, small) < 0.9


def ring(degrees: Points, metres: float) -> Points:
    """Points at these azimuths and this distance, up to 1 m above and below the sensor."""
    angles, heights = np.meshgrid(np.radians(degrees), np.linspace(-1, 1, 9))
    places = [metres * np.cos(angles), metres * np.sin(angles), heights]
    return np.stack(places, axis=-1).reshape(-1, 3).astype(np.float32)


@rows(
    "degrees, metres, small",
    [
        *[(np.arange(-sides, sides), 20, True) for sides in (31.5, 85.5)],
        (np.arange(148.5, 212), 20, True),  # behind, where azimuths jump
        (np.arange(-99.5, 100), 20, False),
        (np.arange(0.5, 360), 20, False),
        (np.arange(0.5, 360, 9), 20, False),  # gaps of less than 10 degrees are in view
        (np.r_[np.arange(0.5, 50), np.arange(180.5, 230)], 20, True),
        (np.r_[np.arange(0.5, 100), np.arange(180.5, 280)], 20, False),
        (np.empty(0), 20, True),
        (np.arange(0.5, 360), 11, True),  # a room
        (np.arange(0.5, 360), 13, False),
    ],
)
def test_a_view_is_small_of_a_room_and_of_less_than_half_of_the_circle(
    degrees: Points, metres: float, small: bool
) -> None:
    prepared = PreparedCloud(ring(degrees, metres))
    assert prepared.is_small_view == small
    assert PreparedCloud.from_bytes(prepared.to_bytes(), prepared.config).is_small_view == small


@rows(
    "overlap, known, least, most",
    [
        (0.8, colors(0.45), 0.95, 1.0),
        (0.8, colors(0.9), 0.0, 0.9),  # a repeated block
        # Nothing in common is improbable, and all is certain.
        *[(0.0, known, 0.0, 1e-3) for known in (None, colors(1.0))],
        *[(1.0, known, 0.99, 1.0) for known in (None, colors(0.2))],
    ],
)
def test_probabilities_are_those_of_what_is_in_common(
    overlap: float, known: Any, least: float, most: float
) -> None:
    assert least < pose_probability(overlap, known) < most


def test_the_right_pose_of_a_made_place_is_probable_and_a_wrong_one_is_not() -> None:
    here, there = at(3, -2, 0), at(5, -1, 0)
    target, source = (painted_blocks(pose, k) for k, pose in enumerate((here, there)))
    truth = np.linalg.inv(here) @ there
    wrong = truth.copy()
    wrong[:2, :2], wrong[:2, 3] = [[-1, 0], [0, -1]], (6, 4)
    for colored in (True, False):
        one, other = (source, target) if colored else (source.points, target.points)
        found = [register(one, other, guess, search=False).probability for guess in (truth, wrong)]
        assert found[0] > 0.95 and found[1] < 0.05


def test_the_same_overlap_of_small_views_is_less_probable() -> None:
    here, there = at(3, -2, 0), at(4, -1.5, 0)
    target, source = (scan_blocks(pose, k) for k, pose in enumerate((here, there)))
    truth = np.linalg.inv(here) @ there

    def cut(points: Points) -> Points:
        return points[np.abs(np.arctan2(points[:, 1], points[:, 0])) < 0.55]

    whole = register(source, target, truth, search=False)
    assert whole.overlap <= whole.mean_overlap
    mean = whole.mean_overlap
    assert whole.probability == pose_probability(whole.overlap, None, mean_overlap=mean)
    for one, other in ((cut(source), cut(target)), (source, cut(target)), (cut(source), target)):
        found = register(one, other, truth, search=False)
        assert 0 < found.agreeing < whole.agreeing
        small = SmallView(found.agreeing, len(found.degenerate))
        assert found.probability == pose_probability(found.overlap, None, small)
        assert found.probability < pose_probability(found.overlap, None)
