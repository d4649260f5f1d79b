# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Sizes and repetitions of a run, and the reasons for bounds that are not met."""

from dataclasses import dataclass

from benchmarks.speed.timing import Limits


@dataclass(frozen=True)
class Settings:
    """A full run, or a quick one that only shows that everything works.

    Attributes:
        small, large: points of the two clouds of most rows.
        tables: rows and width of the descriptor tables that are searched.
        batch: rows of the table whose rows are all compared with each other.
        clusters: sizes of the clouds that are clustered.
        scenes: numbers of stored scenes that one is compared with.
        pose_cell_steps: after which the answers of pose cells are compared.
        maps: nodes of experience maps.
        pairs: of clouds of each recording that are registered.
        clouds, searches, towns: sizes of the curves.
        memory, index: sizes for the peak memory of descriptors and of the index.
        frames: of the sequence that is described.
        limits, slow, curve: of a row, of a row that takes seconds, of a point of a curve.
        patience: seconds that a single call of a curve may take.
        judged: whether bounds are.
    """

    small: int
    large: int
    tables: tuple[tuple[int, int], ...]
    batch: int
    clusters: tuple[int, ...]
    scenes: tuple[int, int]
    pose_cell_steps: int
    maps: tuple[int, int]
    pairs: int
    clouds: tuple[int, ...]
    searches: tuple[int, ...]
    towns: tuple[int, ...]
    memory: tuple[int, ...]
    index: int
    frames: int
    limits: Limits
    slow: Limits
    curve: Limits
    patience: float
    judged: bool


FULL = Settings(
    small=25_000,
    large=150_000,
    tables=((4541, 576), (100_000, 192)),
    batch=4541,
    clusters=(2_000, 20_000, 100_000),
    scenes=(1_000, 100_000),
    pose_cell_steps=150,
    maps=(136, 10_000),
    pairs=20,
    clouds=(2_000, 5_000, 10_000, 25_000, 50_000, 100_000, 200_000, 500_000),
    searches=(1_000, 3_000, 10_000, 30_000, 100_000, 300_000, 1_000_000),
    towns=(136, 400, 1_000, 3_000, 10_000, 30_000),
    memory=(25_000, 100_000, 500_000),
    index=1_000_000,
    frames=350,
    limits=Limits(seconds=3, least=3, most=400),
    slow=Limits(seconds=15, least=3, most=7),
    curve=Limits(seconds=0.5, least=2, most=50),
    patience=2.5,
    judged=True,
)

QUICK = Settings(
    small=1_500,
    large=4_000,
    tables=((300, 576), (1_000, 192)),
    batch=300,
    clusters=(500, 1_000),
    scenes=(50, 200),
    pose_cell_steps=10,
    maps=(136, 400),
    pairs=2,
    clouds=(500, 1_000, 2_000),
    searches=(200, 500, 1_000),
    towns=(136, 400),
    memory=(1_000, 4_000),
    index=5_000,
    frames=6,
    limits=Limits(seconds=0.02, least=2, most=5),
    slow=Limits(seconds=0.02, least=1, most=1),
    curve=Limits(seconds=0.01, least=1, most=2),
    patience=2.5,
    judged=False,
)

_SORTED = (
    "each point has a sorted copy in the blocks that are searched (34 bytes), a normal with its "
    "index (24) and, for SHOT, its place in the histograms; PCL takes three times as much"
)
REASONS: dict[str, str] = {
    "colouring 124,668 points, image 1242x375 / NumPy": (
        "the peer divides only points in front of the camera; a twentieth of its time is less "
        "than reading the scan and the image and writing the cloud take. Of ours 40 % goes into "
        "finding the points in view, 24 % into projecting them, 36 % into pixels and output"
    ),
    "colouring 124,668 points, image 1242x375 / a loop over PCL's and Eigen's types": (
        "0.52 ms without other load on the machine, 0.45 at least; "
        "all times here vary by half from minute to minute"
    ),
    "describe (c-M2DP) over 350 frames of simulated drive, 2 jobs / 1 job": (
        "decoding PNG files takes most of a frame, and zlib alone gains between 1.86 and 2.03 "
        "from two threads here; storing the run, some 20 ms, is one job's; other runs gave 1.67 "
        "to 1.95"
    ),
    "first singular vectors of 64 x 512, robust, one call after the other": (
        "0.043 ms without other load on the machine, two thirds of it for products with the "
        "matrix; all times here vary by half from minute to minute"
    ),
    "first singular vectors of 64 x 512, paper, one call after the other": (
        "as with `robust`, and its second singular value is nearer to the first, so that it takes "
        "more products with the matrix and its transpose"
    ),
    "view of 2,000 points: clusters, hulls, colours / "
    "scikit-learn DBSCAN, SciPy ConvexHull, NumPy": (
        "half of it is DBSCAN, most of the rest Qhull, 0.1 ms a hull of nine boxes full of points; "
        "1.8 ms without other load on the machine; scans of a robot, seen from one side, take 0.8 "
        "to 1.9 ms (docs/results/views.md)"
    ),
    "action on a map of 136 nodes, openratslam / the same sweeps in NumPy": (
        "0.061 ms at least: 20 sweeps that take one link after the other, as the reference does, "
        "so that there is nothing to vectorise; `robust` needs no more than the bound"
    ),
    "scan of 114,278 points in, loop answer out (16,313 coloured, c-M2DP robust, map of 4,541) / "
    "NumPy, the papers word by word, NumPy": (
        "3.5 ms at least, 4.0 in the run before; all times here vary by half from minute to minute"
    ),
    "c-M2DP paper, exponent of the cost": (
        "1.03 in the run before; times of single sizes vary by half from minute to minute"
    ),
    "SHOT, further bytes for each further point": _SORTED,
    "CSHOT, further bytes for each further point": _SORTED,
}
"""Why a bound is not met, from a profile, by the row's name: "what / peer", or "what" alone."""
