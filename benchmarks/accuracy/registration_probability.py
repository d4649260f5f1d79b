# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Fits how probable it is that a registered pose is right, on simulated towns.

python -m benchmarks.accuracy.registration_probability           # poses from the cache, or made
python -m benchmarks.accuracy.registration_probability --write   # and store the model and the table

The poses are those of the candidates that correlate most, of every fourth frame: what a detector
registers. Full circles with the camera's colours and stereo clouds are fitted together. The
overlaps of full circles alone make the model of poses for which there are no colours to compare. A
town takes about a minute of processor time.
"""

import argparse
import itertools
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from textwrap import fill
from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from benchmarks.accuracy.loop_thresholds import FITTED
from benchmarks.accuracy.markdown import table, write_between
from benchmarks.accuracy.presets import ROOT, record_towns
from fusionslam import FusionConfig, LoopConfig, LoopDetector
from fusionslam.datasets import open_dataset
from fusionslam.descriptors import find_descriptor
from fusionslam.evaluation.loops.nearest_matches import find_matches
from fusionslam.loop_closure import Observation
from fusionslam.registration import register, search_poses
from fusionslam.storage.arrays import Floats, Mask, Matrix
from fusionslam.storage.cache import cache_folder

PAGE = ROOT / "docs" / "stages" / "registration.md"
MODEL = ROOT / "python" / "fusionslam" / "registration" / "probability.yaml"
SOURCES = ("lidar", "stereo")
FEATURES = ("overlap", "color_ratio")
KINDS = {
    "full circle": ("lidar", False),
    "full circle, LiDAR and camera": ("lidar", True),
    "stereo": ("stereo", True),
}
"""Source, and whether colours are compared, of each row of the table."""
STEP = 4
"""Of the frames whose candidates are registered."""
REGISTERED = 3
"""Of a frame's candidates."""
METRES, DEGREES = 2.0, 5.0
"""Poses less far off are right."""
LIMITS = ((1.0, 5.0), (METRES, DEGREES), (3.0, 10.0))
RIDGE = 1e-3
"""Keeps the slopes finite where right and wrong poses do not overlap."""
BINS = (0, 0.05, 0.5, 0.95, 0.99, 1.01)


Models = Mapping[str, Floats]
"""Intercept and slopes by kind of pose."""


class Poses(NamedTuple):
    """Registered poses of some drives.

    Attributes:
        features: float64 (N, 2), of ``FEATURES``; the ratio is NaN where no colours are compared.
        errors: float64 (N, 2), metres and degrees.
        weights: float64 (N,).
    """

    features: Floats
    errors: Floats
    weights: Floats

    @property
    def right(self) -> Mask:
        return within(self.errors, METRES, DEGREES)


def joined(towns: Sequence[Poses]) -> Poses:
    """All poses; each town counts alike."""
    weights = [each.weights / each.weights.sum() for each in towns if len(each.weights)]
    features, errors, _ = zip(*towns, strict=True)
    return Poses(np.concatenate(features), np.concatenate(errors), np.concatenate(weights))


def within(errors: Floats, metres: float, degrees: float) -> Mask:
    return np.asarray((errors < (metres, degrees)).all(axis=1), np.bool_)


def register_town(seed: int, source: str, folder: Path) -> Poses:
    """Register the candidates of a town's drive; ``folder`` keeps the poses."""
    path = folder / f"{seed}-{source}.npz"
    if not path.exists():
        (drive,) = record_towns([seed])
        frames = open_dataset(drive)
        detector = LoopDetector("cm2dp", fusion=FusionConfig.model_validate({"source": source}))
        seen = [detector.observe(frame) for frame in frames]
        assert frames.poses is not None  # the simulator knows them
        world_from_cloud = [pose @ frames.body_from_points for pose in frames.poses]
        rows = np.array(list(_register(seen, world_from_cloud)))
        folder.mkdir(parents=True, exist_ok=True)
        np.savez(path, features=rows[:, :2], errors=rows[:, 2:])
    with np.load(path) as stored:
        return Poses(stored["features"], stored["errors"], np.ones(len(stored["errors"])))


def _register(seen: Sequence[Observation], world_from_cloud: Sequence[Matrix]) -> Iterator[Floats]:
    """Yield overlap, ratio of colours, metres and degrees off of each registered pose."""
    clouds = [each.evidence.cloud for each in seen if each.evidence is not None]
    for query, matches in enumerate(_candidates(seen)):
        if query % STEP:
            continue
        cloud = clouds[query]
        found = [(each, k) for k in matches for each in search_poses(cloud, clouds[k])]
        found.sort(key=lambda pair: -pair[0].correlation)
        for hypothesis, match in found[:REGISTERED]:
            result = register(cloud, clouds[match], hypothesis.pose, search=False)
            if result.estimate is None:
                continue
            truth = np.linalg.inv(world_from_cloud[match]) @ world_from_cloud[query]
            error = np.linalg.inv(truth) @ result.estimate
            turn = np.degrees(Rotation.from_matrix(error[:3, :3]).magnitude())
            colors = result.color_difference
            ratio = np.nan if colors is None else colors.ratio
            yield np.array([result.overlap, ratio, np.linalg.norm(error[:3, 3]), turn])


def _candidates(seen: Sequence[Observation]) -> list[set[int]]:
    """The nearest earlier frames of each frame by any of the descriptors."""
    config = LoopConfig()
    union: list[set[int]] = [set() for _ in seen]
    for name in seen[0].vectors:
        vectors = np.array([each.vectors[name] for each in seen])
        metric = find_descriptor(name.split(",")[0]).metric
        found = find_matches(vectors, window=config.window, k=config.candidates, metric=metric)
        for each, row in zip(union, found.indices, strict=True):
            each |= set(row[row >= 0].tolist())
    return union


def fit(features: Floats, right: Mask, weights: Floats) -> Floats:
    """Weighted logistic regression with a ridge on standardised features.

    Args:
        features: (N, F).
        right: (N,).
        weights: (N,).

    Returns:
        (1 + F,): intercept and slopes.
    """
    mean, sd = features.mean(axis=0), features.std(axis=0)
    scaled, shares = (features - mean) / sd, weights / weights.sum()

    def loss(slopes: Floats) -> tuple[float, Floats]:
        score = slopes[0] + scaled @ slopes[1:]
        costs = np.logaddexp(0, np.where(right, -score, score))
        excess = shares * (1 / (1 + np.exp(-score)) - right)
        penalty = RIDGE * np.r_[0, slopes[1:]]
        gradient = np.r_[excess.sum(), scaled.T @ excess] + penalty
        return float(shares @ costs + penalty @ slopes / 2), gradient

    found = minimize(loss, np.zeros(1 + features.shape[1]), jac=True, method="L-BFGS-B").x
    slopes = found[1:] / sd
    model: Floats = np.r_[found[0] - slopes @ mean, slopes]
    return model


def fit_models(towns: Sequence[Mapping[str, Poses]]) -> Models:
    """Fit one model to the overlaps of full circles, and one to those poses that have colours."""
    circles = joined([town["lidar"] for town in towns])
    every = joined([poses for town in towns for poses in town.values()])
    known = np.isfinite(every.features[:, 1])
    return {
        "plain": fit(circles.features[:, :1], circles.right, circles.weights),
        "colored": fit(every.features[known], every.right[known], every.weights[known]),
    }


def predict(models: Models, poses: Poses) -> Floats:
    """The probability of each pose, by the model of its kind."""
    found: Floats = np.empty(len(poses.errors))
    known = np.isfinite(poses.features[:, 1])
    for rows, kind, count in ((~known, "plain", 1), (known, "colored", 2)):
        model = models[kind]
        found[rows] = 1 / (1 + np.exp(-model[0] - poses.features[rows, :count] @ model[1:]))
    return found


def without_colors(poses: Poses) -> Poses:
    return poses._replace(features=poses.features * (1, np.nan))


def model_yaml(models: Models) -> str:
    """Format the models as the package reads them."""
    lines = [
        "# SPDX-FileCopyrightText: 2026 The fusionslam authors",
        "# SPDX-License-Identifier: Apache-2.0",
        "# Logistic regression of right poses. Written by",
        "# python -m benchmarks.accuracy.registration_probability --write",
    ]
    for kind, model in models.items():
        names = ("intercept", *FEATURES)[: len(model)]
        lines += [f"{kind}:"]
        lines += [f"  {name}: {value:.2f}" for name, value in zip(names, model, strict=True)]
    return "\n".join(lines) + "\n"


def predict_held_out(towns: Sequence[Mapping[str, Poses]], kind: str) -> tuple[Floats, Poses]:
    """Predict each town's poses by the fit to the other towns."""
    source, colored = KINDS[kind]
    said, seen = [], []
    for k, town in enumerate(towns):
        poses = town[source] if colored else without_colors(town[source])
        said.append(predict(fit_models([*towns[:k], *towns[k + 1 :]]), poses))
        seen.append(poses)
    return np.concatenate(said), joined(seen)


def calibration_table(towns: Sequence[Mapping[str, Poses]]) -> str:
    """One row per kind of clouds: what was predicted, and what was right of it."""
    least = LoopConfig().min_probability
    rows = []
    for kind in KINDS:
        said, poses = predict_held_out(towns, kind)
        row = [kind, str(len(said))]
        row += [f"{within(poses.errors, *limits).mean():.1%}" for limits in LIMITS]
        for low, high in itertools.pairwise(BINS):
            inside = (said >= low) & (said < high)
            right = poses.right[inside]
            row.append(f"{right.mean():.2f} ({len(right)})" if len(right) else "none")
        accepted = said >= least
        row += [f"{accepted[poses.right].mean():.2f}", str((accepted & ~poses.right).sum())]
        rows.append(row)
    header = ["clouds", "poses", *(f"up to {m:g} m, {deg:g} deg off" for m, deg in LIMITS)]
    header += [f"{low:g} to {min(high, 1):g}" for low, high in itertools.pairwise(BINS)]
    header += [f"right ones with {least:g} or more", "wrong ones"]
    return table(header, rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true")
    parser.add_argument("--poses", type=Path, default=cache_folder() / "registered-poses")
    parser.add_argument("--seeds", nargs="+", type=int, default=FITTED)
    arguments = parser.parse_args()
    towns = [
        {source: register_town(seed, source, arguments.poses) for source in SOURCES}
        for seed in arguments.seeds
    ]
    shown, model = calibration_table(towns), model_yaml(fit_models(towns))
    about = fill(
        f"`python -m benchmarks.accuracy.registration_probability`: the towns of seeds "
        f"{', '.join(map(str, arguments.seeds))}, each predicted by a model that was fitted to the "
        f"others. Right poses are up to {METRES:g} m and {DEGREES:g} degrees off. Columns from one "
        "probability to another: share of right poses (number of all) among those of which it was "
        "predicted.",
        100,
    )
    print(f"{about}\n\n{shown}\n\n{model}")
    if arguments.write:
        MODEL.write_text(model, encoding="utf-8")
        write_between(PAGE, "probability", f"{about}\n\n{shown}")


if __name__ == "__main__":
    main()
