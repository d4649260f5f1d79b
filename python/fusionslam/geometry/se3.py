# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Poses in space, float64 (..., 4, 4), and their small motions (..., 6).

A small motion is x, y, z in metres, then a rotation about x, y, z in radians.
"""

import numpy as np

from fusionslam.base.arrays import Floats


def inverse(poses: Floats) -> Floats:
    """Invert rigid motions, (..., 4, 4)."""
    result = np.zeros_like(poses)
    turned = np.swapaxes(poses[..., :3, :3], -1, -2)
    result[..., :3, :3] = turned
    result[..., :3, 3] = -np.einsum("...ij,...j->...i", turned, poses[..., :3, 3])
    result[..., 3, 3] = 1
    return result


def motion_size(motion: Floats) -> tuple[float, float]:
    """Metres and degrees of a motion, float64 (4, 4)."""
    cosine = np.clip((np.trace(motion[:3, :3]) - 1) / 2, -1, 1)
    return float(np.linalg.norm(motion[:3, 3])), float(np.degrees(np.arccos(cosine)))


def exp(motions: Floats) -> Floats:
    """Poses (..., 4, 4) of small motions (..., 6): the exponential map of SE(3)."""
    from scipy.spatial.transform import Rotation  # slow to import

    motions = np.asarray(motions, np.float64)
    rows = motions.reshape(-1, 6)
    poses = np.tile(np.eye(4), (len(rows), 1, 1))
    poses[:, :3, :3] = Rotation.from_rotvec(rows[:, 3:]).as_matrix()
    poses[:, :3, 3] = np.einsum("nij,nj->ni", _left_jacobian(rows[:, 3:]), rows[:, :3])
    return poses.reshape(*motions.shape[:-1], 4, 4)


def log(poses: Floats) -> Floats:
    """Small motions (..., 6) of poses (..., 4, 4): the inverse of ``exp``."""
    from scipy.spatial.transform import Rotation

    flat = poses.reshape(-1, 4, 4)
    turns = Rotation.from_matrix(flat[:, :3, :3]).as_rotvec()
    places = np.linalg.solve(_left_jacobian(turns), flat[:, :3, 3, None])[..., 0]
    return np.concatenate([places, turns], axis=1).reshape(*poses.shape[:-2], 6)


def skew(vectors: Floats) -> Floats:
    """Matrices (..., 3, 3) of the cross product with vectors (..., 3)."""
    x, y, z = np.moveaxis(vectors, -1, 0)
    o = np.zeros_like(x)
    rows = [o, -z, y, z, o, -x, -y, x, o]
    return np.stack(rows, axis=-1).reshape(*vectors.shape[:-1], 3, 3)


def adjoint(poses: Floats) -> Floats:
    """Matrices (..., 6, 6) that carry small motions through poses: T exp(v) = exp(adjoint v) T."""
    turn = poses[..., :3, :3]
    result = np.zeros((*poses.shape[:-2], 6, 6))
    result[..., :3, :3] = result[..., 3:, 3:] = turn
    result[..., :3, 3:] = skew(poses[..., :3, 3]) @ turn
    return result


def carry_covariance(pose: Floats, covariance: Floats) -> Floats:
    """Covariances (..., 6, 6) of small motions in frame a, of those in frame b.

    ``pose``, (..., 4, 4), is a_from_b.
    """
    carry = adjoint(pose)
    return np.asarray(carry @ covariance @ np.swapaxes(carry, -1, -2))


def _left_jacobian(turns: Floats) -> Floats:
    """Matrices (n, 3, 3) by which ``exp`` makes translations of small motions (Sola 2018)."""
    angle = np.linalg.norm(turns, axis=1)[:, None, None]
    small = angle < 1e-4
    safe = np.where(small, 1.0, angle)
    first = np.where(small, 0.5 - angle**2 / 24, (1 - np.cos(safe)) / safe**2)
    second = np.where(small, 1 / 6 - angle**2 / 120, (safe - np.sin(safe)) / safe**3)
    cross = skew(turns)
    return np.asarray(np.eye(3) + first * cross + second * cross @ cross)
