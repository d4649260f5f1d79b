# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Parse SDF poses."""

import xml.etree.ElementTree as ET

import numpy as np
from scipy.spatial.transform import Rotation

from fusionslam.sim.worlds.missing_resources import Unresolved
from fusionslam.storage.arrays import Matrix


def pose_of(element: ET.Element, owner: str, missing: Unresolved) -> Matrix:
    """parent_from_element, (4, 4): "x y z roll pitch yaw", metres and radians.

    Rotations are about fixed axes, x first: R = Rz(yaw) Ry(pitch) Rx(roll). ``degrees`` and seven
    numbers (with a quaternion x y z w), both from SDF 1.9, are supported; a pose relative to
    another frame than the parent is recorded as missing and read as relative to the parent.
    """
    pose = element.find("pose")
    if pose is None or not (pose.text or "").strip():
        return np.eye(4)
    frame = pose.get("relative_to") or pose.get("frame")
    if frame:
        missing.add("pose", f"{owner} relative to {frame}", "taken as relative to its parent")
    numbers = numbers_of(pose.text, f"pose of {owner}", missing)
    if numbers is None:
        return np.eye(4)
    return _matrix(numbers, pose.get("degrees") == "true", owner, missing)


def numbers_of(text: str | None, owner: str, missing: Unresolved) -> Matrix | None:
    """Parse finite numbers, float64 (N,); None, and recorded, if the text has anything else."""
    try:
        numbers = np.array((text or "").split(), np.float64)
    except ValueError:
        numbers = np.array([np.nan])
    if len(numbers) and np.isfinite(numbers).all():
        return numbers
    missing.add("number", owner, f"expected numbers, found {(text or '').strip()!r}")
    return None


def _matrix(numbers: Matrix, degrees: bool, owner: str, missing: Unresolved) -> Matrix:
    matrix = np.eye(4)
    if len(numbers) == 6:
        turn = Rotation.from_euler("xyz", numbers[3:], degrees=degrees)
    elif len(numbers) == 7 and np.linalg.norm(numbers[3:]) > 0:
        turn = Rotation.from_quat(numbers[3:])
    else:
        missing.add("pose", owner, f"expected x y z roll pitch yaw, found {len(numbers)} numbers")
        return matrix
    matrix[:3, :3] = turn.as_matrix()
    matrix[:3, 3] = numbers[:3]
    return matrix
