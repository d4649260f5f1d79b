# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Fits the probability of an alignment, on the warehouse and on made worlds only.

python -m benchmarks.accuracy.alignment            # fit, and print how well the fit does
python -m benchmarks.accuracy.alignment --write    # and put the weights into the core

Every scan is aligned with its candidates among all older ones. Two that were taken within 0.75 m
and 21 deg are one place, two farther apart than 0.9 m or 25 deg are not, those in between are left
out. It is fitted to the recorded warehouse, of FUSIONSLAM_TEST_DATA, and to the made house and
warehouse; small_house and the made hospital, whose corridors repeat, are only looked at.
"""

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.special import expit

from benchmarks.accuracy.data import data_folder
from benchmarks.accuracy.markdown import table, write_between
from fusionslam.cli.recordings import build_recording
from fusionslam.datasets.range_recording import RecordingConfig
from fusionslam.evaluation import judge_views
from fusionslam.learning.places import measure_gaps
from fusionslam.pipelines.drives import Drive, open_drive
from fusionslam.views import AlignmentConfig, AlignmentIndex, build_scene
from fusionslam.views.recognisers import ALIGNMENT_THRESHOLD

ROOT = Path(__file__).parents[2]
WEIGHTS = ROOT / "cpp" / "src" / "views" / "alignment_weights.inc"
PAGE = ROOT / "docs" / "stages" / "views" / "alignment.md"
MADE = ("house", "warehouse")
RECORDED = (("warehouse", "collision"), ("warehouse", "visual"))
UNSEEN = (("small_house", "collision"), ("small_house", "visual"))
UNSEEN_MADE = ("hospital",)
THRESHOLDS = (0.9, ALIGNMENT_THRESHOLD, 0.98)
REACH_M, TURN_DEG = AlignmentConfig().reach, AlignmentConfig().turn

_SAME = (0.75, 21.0)
_OTHER = (0.9, 25.0)
# Wrong matches with places far away do more harm than those just too far.
_FAR_M, _FAR_WEIGHT = 2.0, 3.0
_DEVIATIONS = 4.0  # from the mean, that count at most, as in the core
_RIDGE = 100.0

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Pairs:
    """Each scan of a drive with its candidates.

    Attributes:
        drive: whose scans they are.
        current, older: rows of its scans, (n,).
        evidence: what alignment found, (n, 12); zeros where nothing could be aligned.
        distance_m, angle_deg: how far apart they truly are, (n,).
    """

    drive: Drive
    current: NDArray[np.intp]
    older: NDArray[np.intp]
    evidence: Floats
    distance_m: Floats
    angle_deg: Floats


def align_pairs(drive: Drive) -> Pairs:
    """Every scan with the candidates among all older ones, aligned without limits."""
    index = AlignmentIndex(AlignmentConfig(reach=100.0, turn=180.0))
    rows, evidence = [], []
    for current in range(len(drive.scenes)):
        cloud = drive.scenes.clouds[current]  # type: ignore[index]
        scene = build_scene(cloud.points, cloud.colors)
        for older, alignment in index.query(scene, threads=0):
            rows.append((current, older))
            evidence.append(list(alignment.evidence.values()))
        index.add(scene)
    pairs, poses = np.array(rows), drive.scenes.true_poses()
    distance, angle = measure_gaps(poses[pairs[:, 0]], poses[pairs[:, 1]])
    return Pairs(drive, pairs[:, 0], pairs[:, 1], np.array(evidence), distance, np.rad2deg(angle))


@dataclass(frozen=True, eq=False)
class Fit:
    """A logistic function of the evidence and its products."""

    mean: Floats
    scale: Floats
    weights: Floats

    def probability(self, evidence: Floats) -> Floats:
        """Of each row, (n,)."""
        known = np.clip((evidence - self.mean) / self.scale, -_DEVIATIONS, _DEVIATIONS)
        found: Floats = expit(_terms(known) @ self.weights)
        return found

    def code(self) -> str:
        """As the core reads it."""
        rows = [self.mean, self.scale, self.weights]
        texts = ["{" + ", ".join(f"{value:.9g}" for value in row) + "}" for row in rows]
        return (
            "// clang-format off\nconstexpr Weights fitted = {\n    "
            + ",\n    ".join(texts)
            + "};\n"
        )


def _terms(values: Floats) -> Floats:
    """A constant, the values, and their products i <= j."""
    i, j = np.triu_indices(values.shape[1])
    return np.hstack([np.ones((len(values), 1)), values, values[:, i] * values[:, j]])


def fit(pairs: Sequence[Pairs]) -> Fit:
    """The ridge-regularised maximum of the likelihood; both answers weigh the same in a world."""
    rows, answers, weights = [], [], []
    for one in pairs:
        same = (one.distance_m < _SAME[0]) & (one.angle_deg < _SAME[1])
        other = (one.distance_m > _OTHER[0]) | (one.angle_deg > _OTHER[1])
        used = (same | other) & one.evidence.any(axis=1)
        harm = np.where(one.distance_m > _FAR_M, _FAR_WEIGHT, 1.0)
        harm = np.where(same, 0.5 / (same & used).sum(), harm / (harm * (other & used)).sum() * 0.5)
        rows.append(one.evidence[used])
        answers.append(same[used])
        weights.append(harm[used] * 1e4)
    evidence, answer, weight = (np.concatenate(parts) for parts in (rows, answers, weights))
    mean, scale = evidence.mean(axis=0), evidence.std(axis=0)
    terms, sign = _terms((evidence - mean) / scale), np.where(answer, 1.0, -1.0)

    def loss(values: Floats) -> tuple[float, Floats]:
        margin = sign * (terms @ values)
        slope = -weight * sign * expit(-margin)
        ridge = np.r_[0.0, values[1:]]
        value = (weight * np.logaddexp(0, -margin)).sum() + _RIDGE / 2 * ridge @ ridge
        return float(value), terms.T @ slope + _RIDGE * ridge

    found = minimize(loss, np.zeros(terms.shape[1]), jac=True, method="L-BFGS-B")
    return Fit(mean, scale, found.x)


def recognise(pairs: Pairs, probability: Floats, threshold: float) -> NDArray[np.int64]:
    """The ids that a matcher gives that stores the first scan of each place."""
    near = (pairs.evidence[:, 10] <= REACH_M) & (pairs.evidence[:, 11] <= np.deg2rad(TURN_DEG))
    likely = np.where(near & pairs.evidence.any(axis=1), probability, 0)
    count = len(pairs.drive.scenes)
    ids, stored, bounds = np.empty(count, np.int64), np.zeros(count, bool), range(count + 1)
    begins = np.searchsorted(pairs.current, list(bounds))
    new = 0
    for row in range(count):
        among = slice(begins[row], begins[row + 1])
        values = np.where(stored[pairs.older[among]], likely[among], 0)
        if values.size and values.max() >= threshold:
            ids[row] = ids[pairs.older[among][values.argmax()]]
        else:
            ids[row], stored[row], new = new, True, new + 1
    return ids


def rows_of(pairs: Pairs, fitted: Fit) -> Iterator[list[str]]:
    """Lines of the table."""
    probability = fitted.probability(pairs.evidence)
    scenes = pairs.drive.scenes
    for threshold in THRESHOLDS:
        ids = recognise(pairs, probability, threshold)
        report = judge_views(ids, scenes.true_poses(), scenes.seconds)
        shares = (report.accuracy, report.loop_recall, report.loop_precision)
        yield [
            " ".join((pairs.drive.name, pairs.drive.shapes)).strip(),
            f"{threshold}",
            *("none" if share is None else f"{100 * share:.1f}" for share in shares),
            f"{report.false_positives}",
            f"{report.mean_false_positive_distance or 0:.2f}",
            f"{report.views}",
        ]


def drives() -> Iterator[tuple[Drive, bool]]:
    """Each drive, and whether it may be fitted to."""
    folder = data_folder()
    for name, shapes in (*RECORDED, *UNSEEN):
        path = folder / "recordings" / f"{name}.npz"
        if path.exists():
            ranges = RecordingConfig.model_validate({"shapes": shapes})
            yield open_drive(path, ranges=ranges), (name, shapes) in RECORDED
    for name in (*MADE, *UNSEEN_MADE):
        yield open_drive(build_recording(Path(name))), name in MADE


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true")
    arguments = parser.parse_args()
    known = [(align_pairs(drive), may) for drive, may in drives()]
    fitted = fit([pairs for pairs, may_fit in known if may_fit])
    lines = [[*line, "yes" if may else "no"] for one, may in known for line in rows_of(one, fitted)]
    head = ["drive", "p >=", "acc. %", "loop R %", "loop P %", "FP", "FP m", "views", "fitted to"]
    text = table(head, lines)
    print(text)
    if arguments.write:
        WEIGHTS.write_text(fitted.code())
        write_between(PAGE, "alignment", text)


if __name__ == "__main__":
    main()
