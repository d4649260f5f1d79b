# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""M2DP, c-M2DP, their singular vectors, normals, SHOT and CSHOT."""

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

import fusionslam
from benchmarks.speed.cases import Agreement, Bound, Case, agree, times_faster
from benchmarks.speed.inputs import Bytes, Inputs, Points
from benchmarks.speed.peers import native
from benchmarks.speed.settings import Settings
from benchmarks.speed.timing import fresh_timer, timer

PAPER = "the papers word by word"
BOTH_OURS = "M2DP first, c-M2DP second"
PAIRS = 1e-5  # share of pairs of point and plane that may count in another bin
WITHIN = 1e-4  # of single values of two descriptors


def m2dp_cases(inputs: Inputs, settings: Settings) -> Iterator[Case]:
    """M2DP and c-M2DP against the reference, and against each other."""
    for size in (settings.small, settings.large):
        points, colors = inputs.sized(size)
        yield _m2dp(points, "paper", times_faster(25) if size == settings.small else None)
        yield _m2dp(points, "robust", None)
        yield _cm2dp(points, colors, "paper", times_faster(20))
        yield _cm2dp(points, colors, "robust", None)
        for preset in ("paper", "robust"):
            yield _color_cost(points, colors, preset)


def _m2dp(points: Points, preset: str, bound: Bound | None) -> Case:
    return Case(
        f"M2DP {preset}, {len(points):,} points",
        PAPER,
        timer(fusionslam.m2dp, points, preset=preset),
        timer(native.paper_m2dp, points),
        lambda: _same_votes(
            fusionslam.m2dp_signature(points, preset="paper"),
            native.paper_m2dp_signature(points),
            len(points),
        ),
        bound,
    )


def _cm2dp(points: Points, colors: Bytes, preset: str, bound: Bound | None) -> Case:
    return Case(
        f"c-M2DP {preset}, {len(points):,} points",
        PAPER,
        timer(fusionslam.cm2dp, points, colors, preset=preset),
        timer(native.paper_cm2dp, points, colors),
        lambda: _same_votes(
            fusionslam.cm2dp_signature(points, colors, preset="paper"),
            native.paper_cm2dp_signature(points, colors),
            len(points),
        ),
        bound,
    )


def _color_cost(points: Points, colors: Bytes, preset: str) -> Case:
    return Case(
        f"cost of colours, c-M2DP by M2DP, {preset}, {len(points):,} points",
        BOTH_OURS,
        timer(fusionslam.m2dp, points, preset=preset),
        timer(fusionslam.cm2dp, points, colors, preset=preset),
        lambda: _same_votes(
            fusionslam.m2dp_signature(points, preset=preset),
            fusionslam.cm2dp_signature(points, colors, preset=preset)[:, :128],
            len(points),
        ),
        Bound("ratio", "<=", 1.9),
    )


def _same_votes(ours: NDArray[np.float64], theirs: NDArray[np.float64], size: int) -> Agreement:
    moved = np.rint((theirs[:, :128] - ours[:, :128]) * size).clip(min=0).sum()
    share = moved / (ours.shape[0] * size)
    colors = np.rint((theirs[:, 128:] - ours[:, 128:]) * size).clip(min=0).sum()
    if colors > 3 * moved:
        share = float("inf")  # colours change their bin with the ring of their point or not at all
    return agree("`paper` signature, share of votes in other bins", share, PAIRS)


def singular_cases(inputs: Inputs, settings: Settings) -> Iterator[Case]:
    """First singular vectors of what c-M2DP takes them of, by default and in the papers."""
    for preset, weigh in (("robust", np.sqrt), ("paper", np.positive)):
        signature = fusionslam.cm2dp_signature(*inputs.sized(settings.small), preset=preset)
        matrix = weigh(signature).astype(np.float32)
        what = f"first singular vectors of 64 x 512, {preset}"
        yield Case(
            f"{what}, one call after the other",
            "",
            timer(fusionslam.first_singular_vectors, matrix),
            None,
            partial(_same_vectors, native.jacobi_svd, matrix),
            Bound("median", "<=", 0.05),
        )
        for peer, name in ((native.jacobi_svd, "JacobiSVD"), (native.bdc_svd, "BDCSVD")):
            yield Case(
                what,
                f"Eigen {name}",
                fresh_timer(fusionslam.first_singular_vectors, matrix),
                fresh_timer(peer, matrix.astype(np.float64)),
                partial(_same_vectors, peer, matrix),
            )


def _same_vectors(peer: Callable[..., Any], matrix: Points) -> Agreement:
    mine = fusionslam.first_singular_vectors(matrix)
    expected = np.hstack(peer(matrix.astype(np.float64)))
    error = min(np.abs(mine - expected).max(), np.abs(mine + expected).max())
    return agree("largest difference of an entry", float(error), 1e-6)


def shot_cases(inputs: Inputs, settings: Settings) -> Iterator[Case]:
    """Normals, SHOT and CSHOT against PCL."""
    for size in (settings.small, settings.large):
        points, colors = inputs.sized(size)
        yield from _shot(points, colors)


def _shot(points: Points, colors: Bytes) -> Iterator[Case]:
    cloud = native.PclCloud(points, colors)
    radius = 5 * fusionslam.cloud_resolution(points)
    size = f"{len(points):,} points"

    def ours(threads: int) -> Points:
        return fusionslam.cshot(points, colors, normal_radius=radius, threads=threads)

    def pcl(threads: int) -> Points:
        surface = native.PclSurface(cloud, radius=radius, threads=threads)
        values: Points = native.pcl_cshot(surface)
        return values

    one, two = "PCL NormalEstimation, SHOTColorEstimation", "PCL NormalEstimationOMP, 2 threads"
    for mine, theirs, peer, bound in ((1, 1, one, 2.5), (2, 1, one, 4), (2, 2, two, 4)):
        yield Case(
            f"normals + CSHOT, {size}, {_threads(mine)}",
            peer,
            timer(ours, mine),
            timer(pcl, theirs),
            partial(_same_call, partial(ours, mine), partial(pcl, theirs)),
            times_faster(bound),
        )
    yield from _normals(points, cloud, radius)
    surface = native.PclSurface(cloud, radius=radius)
    yield from _one_keypoint(points, colors, surface, radius)


def _threads(count: int) -> str:
    return f"{count} thread{'s' if count > 1 else ''}"


def _normals(points: Points, cloud: Any, radius: float) -> Iterator[Case]:
    for threads, peer in ((1, "PCL NormalEstimation"), (2, "PCL NormalEstimationOMP, 2 threads")):
        ours = partial(fusionslam.estimate_normals, points, radius=radius, threads=threads)
        pcl = partial(native.PclSurface, cloud, radius=radius, threads=threads)
        yield Case(
            f"normals, {len(points):,} points, {_threads(threads)}",
            peer,
            timer(ours),
            timer(pcl),
            partial(_same_normals, ours, pcl),
        )


def _same_normals(ours: Callable[[], Any], pcl: Callable[[], Any]) -> Agreement:
    """Where the two smallest eigenvalues are equal any normal is right: 1 in 1000 may differ."""
    normals, _, indices = ours()
    surface = pcl()
    if not np.array_equal(indices, surface.indices()):
        return agree("points with a normal that PCL leaves without", float("inf"), 0)
    off = np.abs(normals - surface.normals()).max(axis=1) > WITHIN
    words = f"share of normals that differ by more than {WITHIN:g}"
    return agree(words, float(off.mean()), 1e-3)


def _one_keypoint(points: Points, colors: Bytes, surface: Any, radius: float) -> Iterator[Case]:
    """The descriptor alone, of points whose normals are given."""
    normals, _, kept = fusionslam.estimate_normals(points, radius=radius)
    for name, given, pcl, peer in (
        ("SHOT", None, native.pcl_shot, "PCL SHOTEstimation"),
        ("CSHOT", colors[kept], native.pcl_cshot, "PCL SHOTColorEstimation"),
    ):
        ours = partial(fusionslam.shot_at_centroid, points[kept], normals, given)
        yield Case(
            f"{name} of one keypoint, {len(points):,} points",
            peer,
            timer(ours),
            timer(pcl, surface),
            partial(_same_call, ours, partial(pcl, surface)),
            times_faster(3),
        )


def _same_call(ours: Callable[[], Points], theirs: Callable[[], Points]) -> Agreement:
    return agree("largest difference of a value", float(np.abs(ours() - theirs()).max()), WITHIN)
