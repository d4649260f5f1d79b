# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Proves the loops of a small robot on a floor, on drives that another simulator recorded.

python -m benchmarks.accuracy.recorded_loops [--write]

Needs the test data, which FUSIONSLAM_TEST_DATA names. A robot whose camera sees a sector has
revisited a place where it was near an earlier pose and looked in the same direction, so that loops
are judged by their poses.
"""

import argparse
import tempfile
from collections.abc import Iterator
from pathlib import Path
from textwrap import fill
from typing import NamedTuple

import numpy as np

from benchmarks.accuracy.alignment import RECORDED
from benchmarks.accuracy.data import ROOT, WORLDS, data_folder
from benchmarks.accuracy.markdown import table, write_between
from fusionslam import DescriptorConfig, PipelineConfig
from fusionslam.base.arrays import Floats, Mask
from fusionslam.config import merged
from fusionslam.evaluation import VerifiedRun
from fusionslam.evaluation.loops.judge import pose_differences
from fusionslam.fusion import ROBOT_FUSION
from fusionslam.loop_closure import LoopConfig
from fusionslam.pipelines.recording import Recording
from fusionslam.pipelines.verified_loops import verify_recording
from fusionslam.registration import RegistrationConfig

PAGE = ROOT / "docs" / "stages" / "loop_closure.md"
AGE_S = 15.0
"""Candidates and revisited places are older than this."""
NEAR, WIDER = (0.6, 20.0), (1.0, 30.0)
"""Metres and degrees between the poses of a revisit; NEAR is what planar registration is for."""
RIGHT = (0.3, 5.0)
"""Metres and degrees that a right pose is off at most."""
CONFIG = PipelineConfig(
    fusion=merged(ROBOT_FUSION, {"source": "cloud"}),
    loop_closure=LoopConfig(window=0, window_seconds=AGE_S),
    registration=RegistrationConfig(method="planar", position_sd=0.02, angle_sd=0.2),
)
ROOMS = DescriptorConfig.model_validate({"scan_context": {"max_range": 20, "height": 0.2}})
DETECTORS = {
    "cm2dp": CONFIG,
    "scan_context": merged(
        CONFIG, {"descriptors": ROOMS.model_dump(), "loop_closure": {"voters": ()}}
    ),
}
"""The default descriptor with its voters, and one alone that is cheaper."""
HEADER = [
    *("recording", "probability fitted to it", "scans", "without points", "found by"),
    *("revisits", "top-1", "recall at 100 % precision", "revisits within 1 m, 30 deg"),
    *("their recall at 100 % precision", "loops", "wrong ones", "recall of the loops"),
    *("error: median", "worst"),
]


class Judged(NamedTuple):
    """Loops of a drive, judged by their poses.

    Attributes:
        metres, degrees: float64 (N,), errors of the poses; NaN where there is none.
        right: bool (N,), poses that are.
        certain: bool (N,), right ones more probable than any wrong one.
    """

    metres: Floats
    degrees: Floats
    right: Mask
    certain: Mask


def judge(run: VerifiedRun) -> Judged:
    """Compare the poses of matches with the true ones."""
    assert run.poses is not None  # the recordings have them
    metres, degrees = (errors[:, 0] for errors in pose_differences(run.matches, run.poses))
    right = (metres <= RIGHT[0]) & (degrees <= RIGHT[1])
    wrong = (run.match >= 0) & ~right
    worst = run.probability[wrong].max(initial=0)
    return Judged(metres, degrees, right, right & (run.probability > worst))


def find_revisits(run: VerifiedRun, metres: float, degrees: float) -> Mask:
    """Bool (N,): frames less far from the pose of one that is older than AGE_S."""
    assert run.poses is not None
    apart = np.linalg.norm(run.poses[:, None, :3, 3] - run.poses[None, :, :3, 3], axis=2)
    ahead = run.poses[:, :3, 0]
    turned = np.degrees(np.arccos(np.clip(ahead @ ahead.T, -1, 1)))
    older = run.stamps_ns[:, None] - run.stamps_ns > AGE_S * 1e9
    return np.asarray((older & (apart < metres) & (turned < degrees)).any(axis=1), np.bool_)


def rows(data: Path) -> Iterator[list[str]]:
    """Yield a line for each recording and detector."""
    for name in WORLDS:
        recording = Recording.at(data / "recordings" / f"{name}.npz")
        dataset = recording.open()
        for descriptor, config in DETECTORS.items():
            with tempfile.TemporaryDirectory() as folder:
                run = verify_recording(
                    recording, dataset, folder, descriptor, config=config, bad_frames="skip"
                )
            fitted = "yes" if name in dict(RECORDED) else "no"
            yield [name, fitted, str(len(dataset)), str(len(run.skipped)), *cells(run)]


def cells(run: VerifiedRun) -> list[str]:
    """Return the cells of a run."""
    found, accepted = judge(run), run.accepted
    near, wider = (find_revisits(run, *limits) for limits in (NEAR, WIDER))
    return [
        f"`{run.name}`",
        str(near.sum()),
        f"{found.right[near].mean():.3f}",
        f"{found.certain[near].mean():.3f}",
        str(wider.sum()),
        f"{found.certain[wider].mean():.3f}",
        str(accepted.sum()),
        str((accepted & ~found.right).sum()),
        f"{(accepted & found.right)[near].mean():.3f}",
        *(
            f"{of(found.metres[accepted]):.3f} m, {of(found.degrees[accepted]):.2f} deg"
            for of in (np.median, np.max)
        ),
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true", help="put the table into the docs")
    arguments = parser.parse_args()
    lines = table(HEADER, list(rows(data_folder())))
    about = fill(
        f"`python -m benchmarks.accuracy.recorded_loops`: revisits are within {NEAR[0]:g} m and "
        f"{NEAR[1]:g} degrees of a pose more than {AGE_S:g} s before, right poses up to "
        f"{RIGHT[0]:g} m and {RIGHT[1]:g} degrees off. Scans without a point above the floor are "
        "left out. Loops and their errors: those that the detector accepts. "
        "scan_context alone: max_range 20 m, height 0.2 m, no voters.",
        100,
    )
    print(f"{about}\n\n{lines}")
    if arguments.write:
        write_between(PAGE, "recorded", f"{about}\n\n{lines}")


if __name__ == "__main__":
    main()
