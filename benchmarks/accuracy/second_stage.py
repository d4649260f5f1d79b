# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What the learned second stage is worth: two Markdown tables.

    python -m benchmarks.accuracy.second_stage [--write]

Needs the test data, which FUSIONSLAM_TEST_DATA names: its recordings of the warehouse and of the
small house (which nothing was chosen or trained by), collision scans, in the robot's frame, without
ground.
"""

import argparse
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.accuracy.data import data_folder
from benchmarks.accuracy.markdown import table, write_between
from fusionslam.datasets.range_recording import RangeRecording, RecordingConfig
from fusionslam.evaluation import judge_views
from fusionslam.learning.places import measure_gaps
from fusionslam.views import build_scene
from fusionslam.views.scenes import SceneIndex
from fusionslam.views.second_stage import MODELS, SecondStage
from fusionslam.views.second_stage.scores import area_under_curve

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "stages" / "views" / "second_stage.md"
WORLDS = ("warehouse", "small_house")
LEAST_POINTS, HELD_OUT = 20, 0.3
SAME = (0.5, np.radians(36))
REVISIT, CORRECT, OLDER_S, NEAR_M = (0.5, np.radians(30)), (0.8, 0.4), 20.0, 4.0
# Threshold of the first stage; of the second stage by name.
THRESHOLDS: tuple[tuple[float, str, float], ...] = (
    (0.70, "", 0.0),
    (0.737, "", 0.0),
    (0.77, "", 0.0),
    (0.70, "thesis", 0.5),
    (0.70, "places", 0.9),
    (0.65, "places", 0.9),
    (0.0, "places", 0.9),
)

Matrix = NDArray[np.float64]


@dataclass(frozen=True)
class Drive:
    """Scans of a world in which something stands, all of them compared with each other.

    Attributes:
        poses, stamps: float64 (n, 3) and (n,).
        similar: float64 (n, n), first stage.
        likely: by model, float64 (n, n), second stage.
    """

    poses: Matrix
    stamps: Matrix
    similar: Matrix
    likely: dict[str, Matrix]


def read(folder: Path, world: str) -> Drive:
    """A recording with all its similarities and probabilities."""
    recording = RangeRecording.open(folder / "recordings" / f"{world}.npz", "collision")
    clouds = [recording.cloud(index, RecordingConfig()) for index in range(len(recording))]
    scenes = [build_scene(cloud.points, cloud.colors) for cloud in clouds]
    kept = [
        index
        for index, scene in enumerate(scenes)
        if len(scene.objects) and len(clouds[index]) >= LEAST_POINTS
    ]
    index = SceneIndex()
    for number in kept:
        index.add(scenes[number])
    likely = {}
    for model in MODELS:
        stage = SecondStage(model)
        rows = np.stack([stage.features(clouds[number]) for number in kept])
        likely[model] = np.stack([stage.probabilities(row, rows) for row in rows]).astype(float)
    assert recording.places is not None
    similar = np.stack([index.similarities(scenes[number]) for number in kept])
    return Drive(recording.places[kept], recording.seconds[kept], similar, likely)


def pair_rows(world: str, drive: Drive) -> list[list[str]]:
    """How well probabilities tell pairs apart."""
    rows = [[f"{world}, `{name}`", *_pairs(drive, p)] for name, p in drive.likely.items()]
    if world == WORLDS[0]:
        where = drive.poses[:, int(np.argmax(np.ptp(drive.poses[:, :2], axis=0)))]
        held = np.flatnonzero(where > np.quantile(where, 1 - HELD_OUT))
        part = Drive(drive.poses[held], drive.stamps[held], drive.similar, {})
        own = drive.likely["thesis"][np.ix_(held, held)]
        rows.append([f"{world}'s held-out part, `thesis`", *_pairs(part, own)])
    return rows


def _pairs(drive: Drive, likely: Matrix) -> list[str]:
    distance, angle = measure_gaps(drive.poses[:, None], drive.poses[None])
    first, second = np.triu_indices(len(likely), 1)
    same = ((distance < SAME[0]) & (angle < SAME[1]))[first, second]
    scores = likely[first, second]
    near = same | (distance[first, second] < NEAR_M)
    older = drive.stamps[:, None] - drive.stamps[None] > OLDER_S
    revisit = (older & (distance < REVISIT[0]) & (angle < REVISIT[1])).any(axis=1)
    best = np.where(older, likely, -1.0).argmax(axis=1)
    right = ((distance < CORRECT[0]) & (angle < CORRECT[1]))[np.arange(len(best)), best]
    return [
        f"{area_under_curve(scores, same):.3f}",
        f"{area_under_curve(scores[near], same[near]):.3f}",
        f"{100 * right[revisit].mean():.1f} % of {revisit.sum()}",
    ]


def match_drive(drive: Drive, least: float, model: str, needed: float) -> tuple[float, float]:
    """Loop recall and loop precision of ids that are given as scans come."""
    # Without a first threshold the second stage alone decides.
    score = drive.similar if least > 0 else drive.likely[model]
    allowed = drive.similar >= least
    if model:
        allowed &= drive.likely[model] >= needed
    ids: list[int] = []
    stored: list[int] = []
    for number in range(len(score)):
        scores = np.where(allowed[number, stored], score[number, stored], -1.0)
        if len(stored) and scores.max() >= 0:
            ids.append(int(scores.argmax()))
        else:
            ids.append(len(stored))
            stored.append(number)
    report = judge_views(ids, drive.poses, drive.stamps)
    assert report.loop_recall is not None and report.loop_precision is not None
    return report.loop_recall, report.loop_precision


def one_stage(drive: Drive) -> list[tuple[float, float]]:
    """Loop recall and loop precision at each threshold of the first stage alone."""
    return [match_drive(drive, float(least), "", 0.0) for least in np.arange(0.5, 0.95, 0.005)]


def _cell(found: tuple[float, float], alone: list[tuple[float, float]], two: bool) -> str:
    text = f"{found[0]:.3f} / {found[1]:.3f}"
    as_many = [precision for recall, precision in alone if recall >= found[0]]
    return f"{text} (one: {max(as_many):.3f})" if two and as_many else text


def _words(least: float, model: str, needed: float) -> str:
    first = f"{least:g}" if least else "no first stage"
    return f"{first}, `{model}` {needed:g}" if model else f"{first}, one stage"


def main() -> None:
    """Print the tables, or write them into the page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--write", action="store_true", help=f"into {PAGE.name}")
    arguments = parser.parse_args()
    folder = data_folder()
    drives = {world: read(folder, world) for world in WORLDS}
    pairs = [row for world, drive in drives.items() for row in pair_rows(world, drive)]
    head = ["", "AUC, all pairs", "AUC, others within 4 m", "nearest older than 20 s is right"]
    tables = {"pairs": table(head, pairs)}
    alone = {world: one_stage(drive) for world, drive in drives.items()}
    rows = [
        [
            _words(*chosen),
            *(
                _cell(match_drive(drive, *chosen), alone[world], bool(chosen[1]))
                for world, drive in drives.items()
            ),
        ]
        for chosen in THRESHOLDS
    ]
    tables["matching"] = table(["similarity from, probability from", *WORLDS], rows)
    for name, text in tables.items():
        print(text, end="\n\n")
        if arguments.write:
            write_between(PAGE, name, text)


if __name__ == "__main__":
    main()
