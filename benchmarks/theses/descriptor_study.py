# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Chapter 4 of Perdomo 2019: descriptors and colour spaces on KITTI, or in the simulated town."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.theses.config import KITTI_SEQUENCES, ReproduceConfig
from fusionslam.base.progress import Step
from fusionslam.config import merged
from fusionslam.descriptors import DescriptorConfig, describe
from fusionslam.errors import DataError
from fusionslam.evaluation import Evaluation, PrecisionRecall, precision_recall
from fusionslam.pipelines.compare_descriptors import DEMO, benchmark
from fusionslam.pipelines.describe import PipelineConfig
from fusionslam.pipelines.recording import Recording
from fusionslam.sensors.frame import Cloud

PROTOCOL = "perdomo2019"
TOWN = "town"
COLOR_SPACES = ("rgb", "hsv", "lab")
_VECTORS = {
    "m2dp_192": ("m2dp", "rgb"),
    "cm2dp_rgb_576": ("cm2dp", "rgb"),
    "cm2dp_hsv_576": ("cm2dp", "hsv"),
    "cm2dp_lab_576": ("cm2dp", "lab"),
    "shot_352": ("shot", "rgb"),
    "cshot_1344": ("cshot", "rgb"),
}
"""File of a stored vector -> descriptor, and colour space if it matters."""


@dataclass(frozen=True, eq=False)
class Measured:
    """A descriptor evaluated on a sequence.

    Attributes:
        case: "KITTI 06" or "town".
        variant: "author", "robust" (ours), or a colour space.
        evaluation: evaluation under all protocols.
    """

    case: str
    variant: str
    evaluation: Evaluation

    @property
    def curve(self) -> PrecisionRecall | None:
        """Curve under the protocol of the thesis's program; None without true poses."""
        return self.evaluation.curves.get(PROTOCOL)


@dataclass(frozen=True, eq=False)
class Stored:
    """Comparison with the data that the author stored.

    Attributes:
        curve: curve of the author's descriptors of KITTI 06.
        rows, equal: rows of the author's curve, and how many of them equal ours to 6 digits.
        vectors: name -> L2 distance between our vector and the author's for the same cloud.
    """

    curve: PrecisionRecall
    rows: int
    equal: int
    vectors: dict[str, float]


@dataclass(frozen=True)
class DescriptorStudy:
    """All measured results.

    Attributes:
        cases: the sequences, in order.
        measured: evaluated descriptors of these sequences.
        stored: comparison with stored data; None if there is none.
    """

    cases: list[str]
    measured: list[Measured]
    stored: Stored | None

    def find(self, case: str, source: str, name: str, variant: str) -> Measured | None:
        """Return one of the results; None if it was not measured."""
        for one in self.measured:
            run = one.evaluation.run
            if (one.case, run.source, run.descriptor, one.variant) == (case, source, name, variant):
                return one
        return None

    def sources(self, case: str) -> list[str]:
        """Return the cloud sources available in a sequence."""
        found = [one.evaluation.run.source for one in self.measured if one.case == case]
        return list(dict.fromkeys(found))


def study_descriptors(
    config: ReproduceConfig, folder: Path, jobs: int, step: Step | None
) -> DescriptorStudy:
    """Describe and evaluate; descriptors that are already stored are reused.

    Raises:
        DataError: unusable data, or the folder cannot be written.
        FusionSlamError: the simulator's extra is not installed.
    """
    recordings = _recordings(config, jobs, step)
    measured: list[Measured] = []
    for case, recording in recordings.items():
        work = partial(_variants, case, recording, folder / case.replace(" ", "-"), jobs, step)
        measured += work(config.quick)
    colored = "KITTI 06" if "KITTI 06" in recordings else next(iter(recordings))
    target = folder / colored.replace(" ", "-")
    for space in COLOR_SPACES:
        settings = {"descriptors": {"preset": "author", "color_space": space}}
        measured += _run(
            colored,
            space,
            recordings[colored],
            # The first colour space was already described with the author's settings.
            target / ("author" if space == "rgb" else space),
            {"lidar": ["cm2dp"]},
            settings,
            jobs,
            step,
        )
    return DescriptorStudy(list(recordings), measured, _judge_stored(config))


def _recordings(config: ReproduceConfig, jobs: int, step: Step | None) -> dict[str, Recording]:
    if config.kitti is None:
        from fusionslam.sim import embedded_drive

        progress = partial(step, "driving through the town") if step is not None else None
        return {TOWN: Recording.at(embedded_drive(jobs=jobs, progress=progress))}
    root = Path(config.kitti).expanduser()
    return {f"KITTI {name}": Recording.at(root, sequence=name) for name in sequences_of_kitti(root)}


def sequences_of_kitti(root: Path) -> list[str]:
    """Return the thesis's sequences in the folder. Raises DataError if there are none."""
    found = [name for name in KITTI_SEQUENCES if (root / "sequences" / name).is_dir()]
    if not found:
        names = ", ".join(f"sequences/{name}" for name in KITTI_SEQUENCES)
        raise DataError(f"{root}: none of KITTI's sequences, expected some of {names}")
    return found


def _variants(
    case: str, recording: Recording, folder: Path, jobs: int, step: Step | None, quick: bool
) -> list[Measured]:
    """Run the thesis's descriptors as its author computes them, and ours."""
    sources = [source for source in recording.sources() if not quick or source == "lidar"]
    published = ("m2dp", "cm2dp") if quick else ("m2dp", "cm2dp", "cshot")
    measured = []
    for variant, names in (("author", published), ("robust", ("m2dp", "cm2dp"))):
        settings = {"descriptors": {"preset": variant}}
        wanted = dict.fromkeys(sources, names)
        measured += _run(case, variant, recording, folder / variant, wanted, settings, jobs, step)
    return measured


def _run(
    case: str,
    variant: str,
    recording: Recording,
    folder: Path,
    wanted: Mapping[str, Sequence[str]],
    settings: Mapping[str, Any],
    jobs: int,
    step: Step | None,
) -> list[Measured]:
    # Dense stereo clouds of the town are thinned, as in the demo.
    thinned = DEMO if case == TOWN else {}
    configs = {
        source: merged(merged(PipelineConfig(), thinned.get(source, {})), settings)
        for source in wanted
    }
    told = None if step is None else _prefix_label(step, f"{case}, {variant}")
    found = benchmark(recording, folder, wanted, configs=configs, jobs=jobs, step=told)
    return [Measured(case, variant, evaluation) for evaluation in found]


def _prefix_label(step: Step, what: str) -> Step:
    return lambda label, done, total: step(f"{what}: {label}", done, total)


def _judge_stored(config: ReproduceConfig) -> Stored | None:
    """Evaluate the author's stored descriptors and describe his cloud again; None without them."""
    root = Path(config.data or "").expanduser()
    if config.data is None or not (root / "descriptors").is_dir():
        return None
    try:
        vectors = np.load(root / "descriptors" / "kitti06_lidar_camera_m2dp.npy")
        file = root / "descriptors" / "kitti06_lidar_camera_m2dp.pr.csv"
        expected = np.loadtxt(file, delimiter=",", skiprows=1)
        distances = _distances(root / "reference" / "cm2dp")
    except (OSError, ValueError, KeyError) as error:
        raise DataError(f"{root}: no stored descriptors: {error}") from error
    from fusionslam.datasets import read_poses_kitti

    places = read_poses_kitti(root / "kitti" / "poses" / "06.txt")[:, :3, 3]
    curve = precision_recall(vectors, places, protocol=PROTOCOL)
    ours = np.column_stack([curve.recall, curve.precision])
    return Stored(curve, len(expected), _equal_rows(ours, expected), distances)


def _equal_rows(ours: NDArray[np.float64], expected: NDArray[np.float64]) -> int:
    """Count the rows that agree to the 6 digits that are stored."""
    if ours.shape != expected.shape:
        return 0
    return int((np.abs(ours - expected) <= 5e-6 * expected).all(axis=1).sum())


def _distances(folder: Path) -> dict[str, float]:
    """Compute L2 distances between our vectors and the author's for the cloud he described."""
    with np.load(folder / "colored_cloud.npz") as held:
        cloud = Cloud(held["xyz"], held["rgb"])
    found = {}
    for file, (name, space) in _VECTORS.items():
        settings = {"preset": "author", "color_space": space}
        ours = describe(cloud, name, merged(DescriptorConfig(), settings))
        found[file] = float(np.linalg.norm(ours - np.load(folder / f"{file}.npy")))
    return found
