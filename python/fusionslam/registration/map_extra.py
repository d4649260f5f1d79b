# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""KISS-Matcher, of the extra ``map``."""

import ctypes
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from fusionslam.base.arrays import Matrix, Points
from fusionslam.errors import FusionSlamError, needing

FEWEST_FEATURES = 10
"""Below, nothing can be matched."""


def _load() -> Any:
    try:
        with needing("map", "registration needs KISS-Matcher"):
            return import_module("kiss_matcher")
    except FusionSlamError as error:
        if sys.version_info < (3, 13):
            raise
        raise FusionSlamError(
            "registration without a guess needs KISS-Matcher, which has no package for Python "
            "3.13 and later: give a guess",
            code="no-package",
            fields=("kiss-matcher",),
        ) from error


def count_features(points: Points, voxel: float) -> int:
    """Count points that surely have features in KISS-Matcher, which crashes if none has.

    It wants three points within 3 voxels, which it compares with squared distances, and three such
    points within 5. Two neighbours within half of that have all of these points in common.
    """
    from scipy.spatial import cKDTree

    if len(points) < 3:
        return 0
    near = min(np.sqrt(3 * voxel), 3 * voxel) / 2
    distances, _ = cKDTree(points).query(points, k=3, distance_upper_bound=near)
    return int(np.isfinite(distances[:, 2]).sum())


def can_search() -> bool:
    """Whether KISS-Matcher is installed."""
    return find_spec("kiss_matcher") is not None


def search_pose(source: Points, target: Points, voxel: float) -> Matrix | None:
    """Search a pose without a guess by KISS-Matcher (Lim et al., ICRA 2025).

    Args:
        source, target: float32 (N, 3), one point a voxel; ``count_features`` must be at least
            ``FEWEST_FEATURES`` in both.

    Returns:
        target_from_source, float64 (4, 4); None if fewer than three points were matched.

    Raises:
        FusionSlamError: KISS-Matcher is not installed (code "missing-extra"), has no package for
            this Python ("no-package") or is not that of PyPI ("other-package").
    """
    kiss_matcher = _load()
    # Its own voxel grid is not repeatable.
    config = kiss_matcher.KISSMatcherConfig(voxel_size=voxel, use_voxel_sampling=False)
    matcher = kiss_matcher.KISSMatcher(config)
    with _one_thread(kiss_matcher):
        solution = matcher.estimate(list(source), list(target))
    if matcher.get_num_final_inliers() < 3:
        return None
    pose = np.eye(4)
    pose[:3, :3] = solution.rotation
    pose[:3, 3] = np.ravel(solution.translation)
    return pose


class _ParallelismLimit(ctypes.Structure):
    """oneTBB's ``global_control`` of max_allowed_parallelism."""

    _fields_ = (("value", ctypes.c_size_t), ("reserved", ctypes.c_ssize_t), ("kind", ctypes.c_int))


@contextmanager
def _one_thread(kiss_matcher: Any) -> Iterator[None]:
    """Let KISS-Matcher use the calling thread alone.

    Its threads write neighbouring bits of one vector<bool>, so that with more of them a result can
    differ from the last one. It has no option; its own copies of TBB and OpenMP have.
    """
    packages = Path(kiss_matcher.__file__).parent.parent
    set_limit, lift_limit, get_threads, set_threads = _thread_functions(packages)
    limit = _ParallelismLimit(1, 0, 0)
    threads = get_threads()
    set_threads(1)
    set_limit(ctypes.byref(limit))
    try:
        yield
    finally:
        lift_limit(ctypes.byref(limit))
        set_threads(threads)


@cache
def _thread_functions(packages: Path) -> tuple[Any, Any, Any, Any]:
    """Those of TBB that set and lift a limit, and those of OpenMP that get and set the threads."""
    folder = packages / "kiss_matcher.libs"
    try:
        tbb, openmp = (
            ctypes.CDLL(str(path))
            for name in ("libtbb", "libgomp")
            for path in folder.glob(f"{name}-*")
        )
        return (
            tbb._ZN3tbb6detail2r16createERNS0_2d114global_controlE,
            tbb._ZN3tbb6detail2r17destroyERNS0_2d114global_controlE,
            openmp.omp_get_max_threads,
            openmp.omp_set_num_threads,
        )
    except (AttributeError, OSError, ValueError) as error:
        found = ", ".join(sorted(path.name for path in folder.glob("*"))) or "nothing"
        raise FusionSlamError(
            "registration without a guess needs kiss-matcher 1.0.2 as PyPI has it, a wheel with "
            f"its own libtbb and libgomp in {folder}; found there: {found} ({error})",
            code="other-package",
            fields=("kiss-matcher",),
        ) from error
