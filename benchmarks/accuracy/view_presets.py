# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What each ingredient of the robust similarity is worth: a Markdown table.

    python -m benchmarks.accuracy.view_presets [RECORDING.npz ...] [--write]

Needs the test data, which FUSIONSLAM_TEST_DATA names: its recordings of the warehouse and of the
small house (which nothing was chosen by). Further recordings of the same layout are measured, too.
Clouds are in the robot's frame, without the ground. A query is compared with all scenes more than
20 s older; correct is a best one within 0.8 m and 0.4 rad.
"""

import argparse
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.accuracy.data import data_folder
from benchmarks.accuracy.markdown import table, write_between
from fusionslam.datasets.range_recording import RangeRecording
from fusionslam.learning.places import measure_gaps
from fusionslam.pipelines.scenes import record_scenes
from fusionslam.views import Scene, SceneConfig, SceneIndex, SimilarityConfig

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "stages" / "views" / "similarity.md"
WORLDS = ("warehouse", "small_house")
OLDER_S = 20.0
REVISIT = (0.5, np.radians(30))
CORRECT = (0.8, 0.4)
PRECISION = 0.97
EXPOSURES = (0.0, 0.05, 0.1, 0.2)

Flags = NDArray[np.bool_]
ROBUST = SimilarityConfig()
VARIANTS: dict[str, tuple[str, SimilarityConfig]] = {
    "`author`": ("author", SimilarityConfig(preset="author")),
    "`paper`": ("paper", SimilarityConfig(preset="paper")),
    "`robust`": ("robust", ROBUST),
    "without colour": ("robust", SimilarityConfig(color_weight=0)),
    "without position": ("robust", SimilarityConfig(distance_weight=0)),
    "without extents": ("robust", SimilarityConfig(extent_weight=0)),
    "volume and ratio instead of extents": (
        "robust",
        SimilarityConfig(extent_weight=0, volume_weight=0.5, ratio_weight=0.5),
    ),
    "tolerances that do not grow with range": ("robust", SimilarityConfig(range_slack=0)),
    "not symmetric": ("robust", SimilarityConfig(symmetric=False)),
    "not normalised": ("robust", SimilarityConfig(normalized=False)),
    "the author's red instead of CIE76": (
        "robust",
        SimilarityConfig(color_difference="author"),
    ),
    "CIEDE2000 instead of CIE76": ("robust", SimilarityConfig(color_difference="ciede2000")),
    "all tolerances halved": (
        "robust",
        SimilarityConfig(
            color_x0=ROBUST.color_x0 / 2,
            color_a=ROBUST.color_a * 2,
            distance_x0=ROBUST.distance_x0 / 2,
            distance_a=ROBUST.distance_a * 2,
            extent_x0=ROBUST.extent_x0 / 2,
            extent_a=ROBUST.extent_a * 2,
        ),
    ),
    "all tolerances doubled": (
        "robust",
        SimilarityConfig(
            color_x0=ROBUST.color_x0 * 2,
            color_a=ROBUST.color_a / 2,
            distance_x0=ROBUST.distance_x0 * 2,
            distance_a=ROBUST.distance_a / 2,
            extent_x0=ROBUST.extent_x0 * 2,
            extent_a=ROBUST.extent_a / 2,
        ),
    ),
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("recordings", nargs="*", type=Path, help="further recordings (.npz)")
    parser.add_argument("--write", action="store_true", help=f"put the table into {PAGE.name}")
    arguments = parser.parse_args()
    recordings = [data_folder() / "recordings" / f"{world}.npz" for world in WORLDS]
    drives = [Drive.of(path) for path in [*recordings, *arguments.recordings]]
    for name, text in (("presets", presets_table(drives)), ("exposure", exposure_table(drives))):
        print(f"{text}\n")
        if arguments.write:
            write_between(PAGE, name, text)


def presets_table(drives: list["Drive"]) -> str:
    """Top-1 correctness and loop recall of every variant in every recording."""
    rows = [
        [name, *(cell for drive in drives for cell in drive.judge(preset, config))]
        for name, (preset, config) in VARIANTS.items()
    ]
    counts = ", ".join(
        f"{d.name} {d.revisits.sum()} revisits of {len(d.stamps)} scans" for d in drives
    )
    words = f"Percent of the revisits ({counts}); in brackets the threshold."
    return f"{table(header('similarity', drives), rows)}\n\n{words} The small house is test only."


def exposure_table(drives: list["Drive"]) -> str:
    """The same for colours whose brightness changes from scan to scan."""
    rows = []
    for spread in EXPOSURES:
        exposed = [drive.change_exposure(spread) for drive in drives]
        for x0 in (ROBUST.color_x0, 4 * ROBUST.color_x0):
            config = SimilarityConfig(color_x0=x0, color_a=ROBUST.color_a * ROBUST.color_x0 / x0)
            name = f"+-{spread:.0%}, color_x0 {x0:g}"
            rows.append(
                [name, *(cell for drive in exposed for cell in drive.judge("robust", config))]
            )
    return table(header("brightness", drives), rows)


def header(first: str, drives: list["Drive"]) -> list[str]:
    """Of both tables."""
    names = [[f"{d.name}: top-1", f"loop recall at {PRECISION:.0%} precision"] for d in drives]
    return [first, *(name for pair in names for name in pair)]


@dataclass(frozen=True)
class Drive:
    """A recording: the scenes of each preset, and which answers would be right.

    Attributes:
        older: (n, n), whether scan j is old enough to be found by scan i.
        correct: (n, n), whether j is where i is.
        revisits: (n,), whether there is anything to be found.
    """

    name: str
    stamps: NDArray[np.float64]
    scenes: dict[str, list[Scene]]
    older: Flags
    correct: Flags
    revisits: Flags

    @classmethod
    def of(cls, path: Path) -> "Drive":
        """Scans that hold nothing above the ground are skipped."""
        with np.load(path) as stored:
            shapes = "collision" if "collision_ray" in stored else "visual"
        recorded = record_scenes(RangeRecording.open(path, shapes)).without_empty()
        stamps, poses = recorded.seconds, recorded.true_poses()
        scenes = {
            preset: recorded.scenes_with(SceneConfig(preset=preset))
            for preset in ("robust", "paper", "author")
        }
        older = stamps[:, None] - stamps > OLDER_S
        revisits = np.asarray((older & within(poses, *REVISIT)).any(axis=1))
        return cls(path.stem, stamps, scenes, older, within(poses, *CORRECT), revisits)

    def change_exposure(self, spread: float) -> "Drive":
        """The colours of every scan times a number of its own between 1 - spread and 1 + spread."""
        random = np.random.default_rng(0)
        scenes = []
        for scene in self.scenes["robust"]:
            objects = scene.objects.copy()
            gain = 1 + random.uniform(-spread, spread)
            objects["color"] = np.clip(objects["color"] * gain, 0, 255)
            scenes.append(Scene(objects))
        return replace(self, scenes={"robust": scenes})

    def judge(self, preset: str, config: SimilarityConfig) -> tuple[str, str]:
        """Top-1 and loop recall, in percent of the revisits, with the threshold of the latter."""
        index = SceneIndex(config)
        for scene in self.scenes[preset]:
            index.add(scene)
        found = np.array([index.similarities(scene) for scene in self.scenes[preset]])
        found[~self.older] = -1
        best = found.argmax(axis=1)
        scans = np.arange(len(best))
        right = self.correct[scans, best] & self.older[scans, best]
        asked = self.older.any(axis=1)
        recall, threshold = recall_at(
            PRECISION, found[scans, best][asked], right[asked], self.revisits[asked]
        )
        found_rightly = f"{100 * recall:.1f} (from {threshold:.2f})"
        return f"{100 * right[self.revisits].mean():.1f}", found_rightly


def within(poses: NDArray[np.float64], meters: float, radians: float) -> Flags:
    """Which poses (x, y, yaw) are so near to which."""
    steps, turns = measure_gaps(poses[:, None], poses)
    return np.asarray((steps <= meters) & (turns <= radians))


def recall_at(
    precision: float, scores: NDArray[np.float64], right: Flags, revisits: Flags
) -> tuple[float, float]:
    """The largest share of revisits found rightly by a threshold that keeps the precision.

    Returns:
        (share, threshold); 0 and infinity if no threshold keeps it.
    """
    order = np.argsort(-scores, kind="stable")
    last = np.append(scores[order][1:] != scores[order][:-1], True)
    precisions = np.cumsum(right[order]) / np.arange(1, len(order) + 1)
    recalls = np.cumsum((right & revisits)[order]) / revisits.sum()
    kept = np.flatnonzero(last & (precisions >= precision))
    if not len(kept):
        return 0.0, np.inf
    best = kept[recalls[kept].argmax()]
    return float(recalls[best]), float(scores[order][best])


if __name__ == "__main__":
    main()
