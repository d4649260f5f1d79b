# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The probability of a registered pose grows with its overlap and falls with its colours."""

from pathlib import Path

import numpy as np
import pytest
import yaml

import fusionslam.registration.probability as probability
from benchmarks.accuracy.registration_probability import MODEL, fit, model_yaml
from clouds import scan_blocks
from fusionslam import Cloud
from fusionslam.registration import ColorDifference, register
from fusionslam.registration.probability import pose_probability
from fusionslam.storage.arrays import Matrix, Points

OVERLAPS = np.linspace(0, 1, 21)


def colors(ratio: float) -> ColorDifference:
    return ColorDifference(10 * ratio, 10.0, 100)


def test_it_is_the_logistic_function_of_the_fitted_model(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    fitted = {
        "plain": {"intercept": -7.0, "overlap": 10.0},
        "colored": {"intercept": -4.0, "overlap": 10.0, "color_ratio": -5.0},
    }
    path = tmp_path / "probability.yaml"
    path.write_text(yaml.safe_dump(fitted), encoding="utf-8")
    monkeypatch.setattr(probability, "_FITTED", path)
    probability._models.cache_clear()
    try:
        assert pose_probability(0.7, None) == pytest.approx(0.5)
        assert pose_probability(0.9, None) == pytest.approx(1 / (1 + np.exp(-2)))
        assert pose_probability(0.7, colors(0.4)) == pytest.approx(1 / (1 + np.exp(-1)))
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
    assert model_yaml({kind: np.array([*each.values()]) for kind, each in stored.items()}) == text


def test_more_overlap_is_more_probable() -> None:
    for known in (None, colors(0.4), colors(0.9)):
        assert (np.diff([pose_probability(each, known) for each in OVERLAPS]) > 0).all()


def test_colors_that_differ_more_are_less_probable() -> None:
    for overlap in (0.6, 0.8):
        found = [pose_probability(overlap, colors(ratio)) for ratio in OVERLAPS]
        assert (np.diff(found) < 0).all()


def test_a_repeated_block_of_other_colors_is_improbable() -> None:
    assert pose_probability(0.8, colors(0.45)) > 0.95
    assert pose_probability(0.8, colors(0.9)) < 0.9


def test_nothing_in_common_is_improbable_and_all_is_certain() -> None:
    for known in (None, colors(1.0)):
        assert pose_probability(0.0, known) < 1e-3
    for known in (None, colors(0.2)):
        assert pose_probability(1.0, known) > 0.99


def paint(points: Points, world_from_sensor: Matrix) -> Cloud:
    """A cloud whose colours change every 4 m of the world."""
    world = points @ world_from_sensor[:3, :3].T + world_from_sensor[:3, 3]
    palette = np.random.default_rng(0).integers(0, 256, (30, 30, 30, 3), dtype=np.uint8)
    return Cloud(points, palette[tuple((np.floor(world / 4).astype(int) % 30).T)])


def test_the_right_pose_of_a_made_place_is_probable_and_a_wrong_one_is_not() -> None:
    pytest.importorskip("small_gicp", reason="the libraries of registration are an extra")
    here, there = np.eye(4), np.eye(4)
    here[:3, 3], there[:3, 3] = (3, -2, 1.7), (5, -1, 1.7)
    target, source = (paint(scan_blocks(pose, k), pose) for k, pose in enumerate((here, there)))
    truth = np.linalg.inv(here) @ there
    wrong = truth.copy()
    wrong[:2, :2], wrong[:2, 3] = [[-1, 0], [0, -1]], (6, 4)
    for colored in (True, False):
        one, other = (source, target) if colored else (source.points, target.points)
        found = [register(one, other, guess, search=False).probability for guess in (truth, wrong)]
        assert found[0] is not None and found[0] > 0.95
        assert found[1] is not None and found[1] < 0.05
