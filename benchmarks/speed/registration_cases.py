# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Clouds of consecutive places registered from a guess, ours beside small_gicp."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
import small_gicp
from scipy.spatial.transform import Rotation

from benchmarks.accuracy.euroc_loops import differences
from benchmarks.real.recordings import read_recording
from benchmarks.speed.cases import Agreement, Case, agree, times_faster
from benchmarks.speed.inputs import Inputs, test_data
from benchmarks.speed.settings import Settings
from benchmarks.speed.timing import timer
from fusionslam import voxel_downsample
from fusionslam._core import SurfaceCloud, refine_pose
from fusionslam.base.arrays import Floats, Matrix, Points
from fusionslam.registration import RegistrationConfig, fit_lengths
from fusionslam.sensors.frame import Cloud

PEER = "small_gicp"
RECORDED = {"kitti00_keyframes": "KITTI 00", "euroc_v101": "EuRoC V1_01"}
_OFF_M, _OFF_DEG = 0.2, 1.0
"""Standard deviations of a guess, along and about each axis."""
_MOST_M, _MOST_DEG = 2e-3, 0.02


class Pair(NamedTuple):
    """Two clouds of one point a voxel, and a guess of target_from_source.

    Attributes:
        source, target: float32 (N, 3).
        start: float64 (4, 4).
        distance: metres; farther neighbours do not correspond.
    """

    source: Points
    target: Points
    start: Matrix
    distance: float


def make_pairs(clouds: Sequence[Cloud], poses: Floats, count: int) -> list[Pair]:
    """Pair each cloud with the next one, evenly over a recording.

    Args:
        clouds: at least two.
        poses: float64 (N, 4, 4), world_from_cloud; guesses are somewhat off them.
        count: of pairs, at most.
    """
    random = np.random.default_rng(0)
    rows = np.linspace(0, len(clouds) - 2, min(count, len(clouds) - 1)).astype(int)
    config = fit_lengths([clouds[0]], RegistrationConfig())
    pairs = []
    for row in rows:
        target, source = (
            voxel_downsample(clouds[each].points, size=config.voxel)[0] for each in (row, row + 1)
        )
        off = np.eye(4)
        off[:3, :3] = Rotation.from_rotvec(random.normal(0, np.radians(_OFF_DEG), 3)).as_matrix()
        off[:3, 3] = random.normal(0, _OFF_M, 3)
        start = np.linalg.inv(poses[row]) @ poses[row + 1] @ off
        pairs.append(Pair(source, target, start, config.distance))
    return pairs


def recorded_pairs(name: str, count: int) -> list[Pair]:
    """The same of a recording of the test data; none where it is missing."""
    data = test_data()
    recording = read_recording(data, name) if data else None
    return [] if recording is None else make_pairs(recording.clouds, recording.poses, count)


def registration_cases(inputs: Inputs, settings: Settings) -> Iterator[Case]:
    """Preparing clouds, and refining poses of prepared ones."""
    frames = [inputs.sequence[row] for row in range(settings.pairs + 1)]
    town = [Cloud(frame.points) for frame in frames if frame.points is not None]
    poses = np.array([frame.pose for frame in frames])
    sets = {"the simulated town": make_pairs(town, poses, settings.pairs)}
    sets |= {words: recorded_pairs(name, settings.pairs) for name, words in RECORDED.items()}
    for words, pairs in sets.items():
        if pairs:
            yield from _cases(words, pairs)


def _cases(words: str, pairs: list[Pair]) -> Iterator[Case]:
    sources, targets = [pair.source for pair in pairs], [pair.target for pair in pairs]
    starts = [pair.start for pair in pairs]
    distances = [pair.distance for pair in pairs]
    mine = list(zip(map(SurfaceCloud, sources), map(SurfaceCloud, targets), strict=True))
    theirs = list(zip(map(prepare_by_peer, sources), map(prepare_by_peer, targets), strict=True))

    def refine() -> list[Matrix]:
        return [
            refine_pose(*clouds, start, distance=distance).target_from_source
            for clouds, start, distance in zip(mine, starts, distances, strict=True)
        ]

    def refine_by_peer() -> list[Matrix]:
        return [
            align_by_peer(*clouds, start, distance)
            for clouds, start, distance in zip(theirs, starts, distances, strict=True)
        ]

    def check() -> Agreement:
        exact = [
            align_by_peer(*clouds, start, distance, step=1e-5)
            for clouds, start, distance in zip(theirs, starts, distances, strict=True)
        ]
        return compare_poses(refine(), exact)

    size = round(float(np.median([len(each) for each in sources])), -2)
    what = f"{len(pairs)} clouds of {words}, {size:,.0f} voxels"
    yield Case(
        f"{what}, prepared for registration",
        PEER,
        timer(lambda: list(map(SurfaceCloud, sources))),
        timer(lambda: list(map(prepare_by_peer, sources))),
        check,
        times_faster(3),
    )
    yield Case(
        f"{what}, registered", PEER, timer(refine), timer(refine_by_peer), check, times_faster(3)
    )


def compare_poses(ours: Sequence[Matrix], theirs: Sequence[Matrix]) -> Agreement:
    """Raises WrongAnswer if the median of the differences is more than 2 mm or 0.02 degrees."""
    metres, degrees = np.median(
        [differences(one, other) for one, other in zip(ours, theirs, strict=True)], axis=0
    )
    agree("median difference of turns, deg", float(degrees), _MOST_DEG)
    return agree("median difference of positions, m", float(metres), _MOST_M)


PeerCloud = tuple[small_gicp.PointCloud, small_gicp.KdTree]


def prepare_by_peer(points: Points) -> PeerCloud:
    """Covariances of the ten nearest points, as ours."""
    cloud = small_gicp.PointCloud(points.astype(np.float64))
    tree = small_gicp.KdTree(cloud)
    small_gicp.estimate_covariances(cloud, tree, num_neighbors=10, num_threads=1)
    return cloud, tree


def align_by_peer(
    source: PeerCloud,
    target: PeerCloud,
    start: Matrix,
    distance: float,
    *,
    step: float | None = None,
) -> Matrix:
    """Its generalised ICP, float64 (4, 4), target_from_source.

    Args:
        source, target, start, distance: as of ``refine_pose``.
        step: it ends below so many metres and radians; None is 1 mm and 0.1 degrees, as usual.
    """
    limits = {} if step is None else {"translation_epsilon": step, "rotation_epsilon": step}
    found = small_gicp.align(
        target[0],
        source[0],
        target[1],
        start,
        registration_type="GICP",
        max_correspondence_distance=distance,
        num_threads=1,
        max_iterations=30 if step is None else 100,
        **limits,
    )
    return np.array(found.T_target_source)
