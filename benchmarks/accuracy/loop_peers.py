# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Compares loops with those of MapClosures and of KISS-SLAM's loop closer, on simulated towns.

python -m benchmarks.accuracy.loop_peers              # the first town
python -m benchmarks.accuracy.loop_peers 1 2 3        # towns of these seeds
python -m benchmarks.accuracy.loop_peers 1 2 --write  # and put the table into the docs

All get the full circle of the LiDAR, are judged by the same protocols and are timed in the same
run, by the processor time of all their threads, which other load of the machine hardly changes. The
peers run in an environment of their own, which is installed into the user's cache (1.6 GB, from the
network). Where that or a peer fails, the program says so and goes on without it. MapClosures is
made for local maps: there it gets ten scans around each, joined by the true poses, as does
KISS-SLAM, whose odometry cannot follow scans 2 m apart. A town takes about ten minutes of processor
time.
"""

import argparse
import hashlib
import subprocess
import sys
import tempfile
import time
import venv
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from textwrap import fill

import numpy as np

from benchmarks.accuracy.markdown import table, write_between
from benchmarks.accuracy.presets import ROOT, mean_and_range, record_towns
from benchmarks.accuracy.verified_loops import ALL, PAGE, figures_of
from fusionslam import Cloud, FusionConfig, LoopDetector, fuse
from fusionslam.base.arrays import Floats, Integers, Mask
from fusionslam.base.cache import cache_folder
from fusionslam.datasets import open_dataset
from fusionslam.evaluation import (
    DescriptorRun,
    Evaluation,
    VerifiedRun,
    evaluate,
    evaluate_verified,
)
from fusionslam.loop_closure.loop import may_be_right
from fusionslam.pipelines.recording import body_from_clouds

FOLDER = ROOT / "benchmarks" / "peers" / "loop_closers"
PLAIN = "scan_context"
CLOUDS = FusionConfig(source="cloud")
WINDOW = 50
PROTOCOLS = ("revisit", "pose-1m-5deg")
OURS = "fusionslam"
FIGURES = ("top-1", "recall at 100 % precision", "recall of the accepted", "wrong ones accepted")
HEADER = ("found by", "protocol", *FIGURES, "ms a frame", "times ours")


PEERS: Mapping[int, tuple[str, ...]] = {
    1: ("MapClosures",),
    10: ("MapClosures, local maps", "KISS-SLAM's closer, local maps"),
}
"""Peers that find the same candidates, by the number of scans joined to a local map."""


def peers_python() -> Path | None:
    """The interpreter of the peers' environment, which is made where it is missing.

    None, with the reason on stderr, where the packages cannot be installed.
    """
    requirements = FOLDER / "requirements.txt"
    digest = hashlib.sha256(requirements.read_bytes()).hexdigest()[:12]
    folder = cache_folder() / f"loop-closers-{digest}"
    python, complete = folder / "bin" / "python", folder / "complete"
    if not complete.exists():
        pip = [str(python), "-m", "pip", "install", "--quiet", "--requirement", str(requirements)]
        try:
            venv.create(folder, with_pip=True, clear=True)
            subprocess.run(pip, capture_output=True, text=True, check=True)
        except (OSError, subprocess.CalledProcessError) as error:
            note(f"without the peers, which cannot be installed: {last_line(error)}")
            return None
        complete.touch()
    return python


def last_line(error: OSError | subprocess.CalledProcessError) -> str:
    """The last line that a failed command wrote to stderr, else the error."""
    said = getattr(error, "stderr", None) or ""
    return (said.strip().splitlines() or [str(error)])[-1]


def note(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


def peers_of(scans: int) -> tuple[str, ...]:
    """Names of the peers of local maps of so many scans."""
    return PEERS[1 if scans == 1 else 10]


def run_peer(
    python: Path,
    scans: int,
    clouds: Sequence[Cloud],
    poses: Floats,
    older: Integers | None = None,
) -> list[VerifiedRun]:
    """Find the loops of clouds joined to local maps, by the peers of ``scans``.

    Args:
        python: interpreter of the peers' environment.
        scans: joined to a local map.
        clouds: N of them.
        poses: float64 (N, 4, 4), world_from_cloud.
        older: int64 (N,), number of the first clouds that are candidates of each; None for those
            outside the window.
    """
    with tempfile.TemporaryDirectory() as folder:
        given, found = Path(folder) / "given.npz", Path(folder) / "found.npz"
        np.savez(
            given,
            points=np.concatenate([cloud.points for cloud in clouds]),
            ends=np.cumsum([len(cloud) for cloud in clouds]),
            poses=poses,
            older=np.arange(len(clouds)) - WINDOW if older is None else older,
            scans=scans,
        )
        command = [str(python), str(FOLDER / "worker.py"), str(given), str(found)]
        subprocess.run(command, check=True, capture_output=True, text=True)
        with np.load(found) as stored:
            result = dict(stored)
    score = result.pop("score")
    result["probability"] = score / (1 + score)  # only their order counts
    return [
        as_run(name, clouds, poses, **{key: values[row] for key, values in result.items()})
        for row, name in enumerate(peers_of(scans))
    ]


def run_peers(
    python: Path,
    clouds: Sequence[Cloud],
    poses: Floats,
    older: Integers | None = None,
    scans: Sequence[int] = tuple(PEERS),
) -> Iterator[tuple[int, VerifiedRun]]:
    """Run the peers on local maps of each number of ``scans``, with which a run is yielded.

    Those that fail are left out, with the reason on stderr. Other arguments as of ``run_peer``.
    """
    for joined in scans:
        note(f"{'; '.join(peers_of(joined))}, of {joined}")
        try:
            yield from ((joined, run) for run in run_peer(python, joined, clouds, poses, older))
        except (OSError, subprocess.CalledProcessError) as error:
            note(f"without {'; '.join(peers_of(joined))}: {last_line(error)}")


def run_ours(clouds: Sequence[Cloud], poses: Floats) -> VerifiedRun:
    """Find the loops of clouds by Scan Context and what votes beside it, verified."""
    detector = LoopDetector(PLAIN, window=WINDOW, fusion=CLOUDS, verify=True)
    return run_detector(detector, clouds, poses)


def run_detector(
    detector: LoopDetector,
    clouds: Sequence[Cloud],
    poses: Floats,
    *,
    stamps_ns: Integers | None = None,
    odometry: Floats | None = None,
) -> VerifiedRun:
    """Find the loops of clouds by a detector that verifies them.

    ``poses`` and ``odometry`` are float64 (N, 4, 4), world_from_cloud and odom_from_cloud.
    """
    count = len(clouds)
    match, probability = np.full(count, -1), np.zeros(count)
    estimates, accepted = np.full((count, 4, 4), np.nan), np.zeros(count, np.bool_)
    seconds = np.zeros(count)
    for row, cloud in enumerate(clouds):
        stamp = None if stamps_ns is None else int(stamps_ns[row])
        moved = None if odometry is None else odometry[row]
        start = time.process_time()
        accepted[row] = detector.add(cloud, stamp_ns=stamp, odometry=moved) is not None
        seconds[row] = time.process_time() - start
        best = detector.nearest
        if best is not None and may_be_right(best):
            match[row], probability[row] = best.match, best.probability
            estimates[row] = best.match_from_query
    return as_run(
        OURS,
        clouds,
        poses,
        stamps_ns=stamps_ns,
        match=match,
        match_from_query=estimates,
        probability=probability,
        accepted=accepted,
        seconds=seconds,
    )


def run_plain(clouds: Sequence[Cloud], poses: Floats) -> DescriptorRun:
    """Describe the clouds by Scan Context alone; describing and comparing them is timed."""
    detector = LoopDetector(PLAIN, window=WINDOW, fusion=CLOUDS, verify=False)
    vectors, seconds = [], []
    for cloud in clouds:
        start = time.process_time()
        seen = detector.observe(cloud)
        detector.add_observation(seen)
        seconds.append(time.process_time() - start)
        vectors.append(seen.vectors[PLAIN])
    rows = np.arange(len(clouds))
    return DescriptorRun(
        source="cloud",
        descriptor=PLAIN,
        dataset="town",
        descriptors=np.stack(vectors),
        frames=rows,
        stamps_ns=rows,
        poses=poses,
        seconds={"match": np.array(seconds)},
        peak_memory_bytes=0,
        points=np.array([len(cloud) for cloud in clouds]),
    )


def as_run(
    name: str,
    clouds: Sequence[Cloud],
    poses: Floats,
    *,
    stamps_ns: Integers | None = None,
    match: Integers,
    match_from_query: Floats,
    probability: Floats,
    accepted: Mask,
    seconds: Floats,
) -> VerifiedRun:
    """Make a run of the matches of each cloud, with the clouds' frames as body of the poses."""
    count = len(clouds)
    return VerifiedRun(
        source="cloud",
        descriptors=(name,),
        dataset="town",
        frames=np.arange(count),
        numbers=np.arange(count),
        stamps_ns=np.arange(count) if stamps_ns is None else stamps_ns,
        poses=poses,
        body_from_cloud=np.tile(np.eye(4), (count, 1, 1)),
        points=np.array([len(cloud) for cloud in clouds]),
        match=match,
        match_from_query=match_from_query,
        covariance=np.full((count, 6, 6), np.nan),
        overlap=np.full(count, np.nan),
        probability=np.where(match >= 0, probability, np.nan),
        distance=np.full(count, np.inf),
        accepted=accepted,
        candidates=match[:, None],
        seconds={"match": seconds},
    )


def compare(seed: int, python: Path | None) -> list[Evaluation]:
    """Evaluate ours and the peers on the town of a seed, the peers only with their ``python``."""
    (drive,) = record_towns([seed])
    dataset = open_dataset(drive)
    places = body_from_clouds(dataset, CLOUDS)
    assert dataset.poses is not None and places is not None  # the simulator writes both
    clouds, poses = [fuse(frame, CLOUDS) for frame in dataset], dataset.poses @ places
    note(f"town of seed {seed}, {len(clouds)} scans: {OURS}")
    runs = [run_ours(clouds, poses)]
    if python is not None:
        runs += [run for _, run in run_peers(python, clouds, poses)]
    plain = evaluate(run_plain(clouds, poses), protocols=PROTOCOLS, window=WINDOW)
    found = [*(evaluate_verified(run, protocols=PROTOCOLS, window=WINDOW) for run in runs), plain]
    note(table(HEADER, list(rows([found]))))
    return found


def rows(towns: Sequence[Sequence[Evaluation]]) -> Iterator[list[str]]:
    """Yield a row for each detector and protocol: mean (lowest to highest) over the towns.

    Times are the medians over a town's frames; their ratio is to ours in the same town. A detector
    that failed in some towns is that of the others.
    """
    found: dict[str, list[tuple[Evaluation, float]]] = {}
    for town in towns:
        ours = next(each for each in town if each.run.descriptor == OURS)
        for evaluation in town:
            ratio = _median_ms(evaluation) / _median_ms(ours)
            found.setdefault(evaluation.run.descriptor, []).append((evaluation, ratio))
    for name, evaluations in found.items():
        known = [figures_of(evaluation) for evaluation, _ in evaluations]
        times = [_median_ms(evaluation) for evaluation, _ in evaluations]
        ratios = [ratio for _, ratio in evaluations]
        for protocol in (each for each in PROTOCOLS if any((each, FIGURES[0]) in k for k in known)):
            values = [[each.get((protocol, figure), {}) for each in known] for figure in FIGURES]
            cells = [[value[ALL] for value in column if ALL in value] for column in values]
            figures = [mean_and_range(np.array(cell, float)) if cell else "" for cell in cells]
            costs = [mean_and_range(np.array(cell)) for cell in (times, ratios)]
            yield [name, protocol, *figures, *costs]


def _median_ms(evaluation: Evaluation) -> float:
    assert evaluation.costs.frame is not None
    return evaluation.costs.frame.median_ms


def describe(seeds: Sequence[int], lines: Sequence[Sequence[str]]) -> str:
    """The command, what its figures are, and the table."""
    listed, s = ", ".join(map(str, seeds)), "s" if len(seeds) > 1 else ""
    command = f"python -m benchmarks.accuracy.loop_peers {' '.join(map(str, seeds))} --write"
    text = (
        f"`{command}`: full circle, town{s} of seed{s} {listed}, radius 10 m, window {WINDOW} "
        "frames. Milliseconds are processor time of all threads, median over the frames. Local "
        "maps: ten scans around each, joined by the true poses; joining them is not timed."
    )
    return f"{fill(text, 100)}\n\n{table(HEADER, lines)}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("seeds", nargs="*", type=int, default=[1])
    parser.add_argument("--write", action="store_true")
    arguments = parser.parse_args()
    python = peers_python()
    towns = [compare(seed, python) for seed in arguments.seeds]
    text = describe(arguments.seeds, list(rows(towns)))
    if arguments.write:
        write_between(PAGE, "peers", text)
    print(text)


if __name__ == "__main__":
    main()
