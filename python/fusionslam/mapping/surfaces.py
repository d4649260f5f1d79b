# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""How thick the surfaces of clouds are that several keyframes show."""

import numpy as np

from fusionslam.base.arrays import Floats, Integers, Mask, Points

_PATCH_M = 0.4
_FEWEST = 10
"""Points of a patch."""
_FLAT = 0.1
"""Variance across a surface, of the lesser one along it."""


def thickening(before: Floats, after: Floats) -> float:
    """How much thicker surfaces of points, float64 (N, 3), get as these move elsewhere.

    The sum over points of what their patches gain in standard deviation, metres. Points that were
    in one cube before stay together; cubes with a flat surface, before or after, count.
    """
    patches, counts = patches_of(before)
    thick, is_flat = zip(*(thickness(points, patches) for points in (before, after)), strict=True)
    counted = (is_flat[0] | is_flat[1]) & (counts >= _FEWEST)
    return float((thick[1] - thick[0])[counted] @ counts[counted])


def patches_of(points: Floats | Points, side: float = _PATCH_M) -> tuple[Integers, Integers]:
    """Number the cubes that points, (N, 3), are in: int64 (N,), and how many are in each."""
    cells = np.floor(points / side).astype(np.int64)
    spans = np.ptp(cells, axis=0) + 1
    keys = np.ravel_multi_index(tuple((cells - cells.min(axis=0)).T), tuple(spans))
    _, patches, counts = np.unique(keys, return_inverse=True, return_counts=True)
    return patches.reshape(-1), counts


def thickness(points: Floats | Points, patches: Integers) -> tuple[Floats, Mask]:
    """Standard deviations of points, (N, 3), across the plane of each patch, and which are flat."""
    count = np.bincount(patches)
    mean = np.stack([np.bincount(patches, axis) for axis in points.T], axis=1) / count[:, None]
    off = points - mean[patches]
    products = [[np.bincount(patches, a * b) / count for b in off.T] for a in off.T]
    variances = np.linalg.eigvalsh(np.moveaxis(np.array(products), -1, 0))
    is_flat = variances[:, 0] < _FLAT * variances[:, 1]
    return np.sqrt(variances[:, 0].clip(0)), is_flat


def doubling(one: Points, other: Points) -> tuple[float, float] | None:
    """Measure how well the surfaces of two placed clouds, float32 (N, 3), cover each other.

    Returns:
        Of the flat patches that both show, in metres: the standard deviation of their joint points
        across the surface, in the median, and the part of it that comes from the clouds lying
        apart, half their distance, which nine tenths of the patches do not exceed: floors do not
        show that walls are apart. None without such a patch.
    """
    sides = len(one), len(other)
    patches, _ = patches_of(np.concatenate([one, other]))
    parts = patches[: sides[0]], patches[sides[0] :]
    count = int(patches.max(initial=-1)) + 1
    shown = np.min([np.bincount(part, minlength=count) for part in parts], axis=0) >= _FEWEST
    if not shown.any():
        return None
    number = np.cumsum(shown) - 1
    kept = [
        (cloud[shown[part]], number[part[shown[part]]])
        for cloud, part in zip((one, other), parts, strict=True)
    ]
    (own, is_flat), (their, is_flat_there) = (thickness(*each) for each in kept)
    joint, _ = thickness(*(np.concatenate(each) for each in zip(*kept, strict=True)))
    counts = [np.bincount(part) for _, part in kept]
    within = (counts[0] * own**2 + counts[1] * their**2) / (counts[0] + counts[1])
    flat = is_flat | is_flat_there
    if not flat.any():
        return None
    apart = np.sqrt((joint**2 - within).clip(0))
    return float(np.median(joint[flat])), float(np.percentile(apart[flat], 90))
