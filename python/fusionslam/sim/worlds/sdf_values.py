# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Read poses, numbers and colours of SDF elements."""

import xml.etree.ElementTree as ET

import numpy as np
from scipy.spatial.transform import Rotation

from fusionslam.base.arrays import Matrix
from fusionslam.sim.worlds.resource_paths import Unresolved

Color = tuple[float, float, float]

# Diffuse colours of Gazebo's built-in plain materials.
GAZEBO_COLORS: dict[str, Color] = {
    "Black": (0.0, 0.0, 0.0),
    "Blue": (0.0, 0.0, 1.0),
    "DarkGrey": (0.175, 0.175, 0.175),
    "FlatBlack": (0.1, 0.1, 0.1),
    "Gold": (0.8, 0.649, 0.12),
    "Green": (0.0, 1.0, 0.0),
    "Grey": (0.7, 0.7, 0.7),
    "Indigo": (0.33, 0.0, 0.5),
    "Orange": (1.0, 0.509, 0.047),
    "Purple": (1.0, 0.0, 1.0),
    "Red": (1.0, 0.0, 0.0),
    "SkyBlue": (0.13, 0.44, 0.7),
    "Turquoise": (0.0, 1.0, 1.0),
    "White": (1.0, 1.0, 1.0),
    "Yellow": (1.0, 1.0, 0.0),
}


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
    matrix = np.eye(4)
    if len(numbers) == 6:
        turn = Rotation.from_euler("xyz", numbers[3:], degrees=pose.get("degrees") == "true")
    elif len(numbers) == 7 and np.linalg.norm(numbers[3:]) > 0:
        turn = Rotation.from_quat(numbers[3:])
    else:
        missing.add("pose", owner, f"expected x y z roll pitch yaw, found {len(numbers)} numbers")
        return matrix
    matrix[:3, :3] = turn.as_matrix()
    matrix[:3, 3] = numbers[:3]
    return matrix


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


def color_of(material: ET.Element | None, owner: str, missing: Unresolved) -> Color | None:
    """Diffuse colour, else ambient, else that of the script's name; None if there is none.

    Textures of scripts and of physically based materials are not supported and are recorded as
    missing.
    """
    if material is None:
        return None
    if material.find("pbr") is not None:
        missing.add("material", f"pbr of {owner}", "not supported, its plain colours are used")
    for key in ("diffuse", "ambient"):
        written = material.findtext(key)
        if written is None:
            continue
        try:
            red, green, blue = (float(number) for number in written.split()[:3])
        except ValueError:
            found = f"expected three or four numbers, found {written.strip()!r}"
            missing.add("material", f"{key} of {owner}", found)
            return None
        return red, green, blue
    name = (material.findtext("script/name") or "").strip()
    if not name:
        return None
    color = GAZEBO_COLORS.get(name.removeprefix("Gazebo/"))
    if color is None:
        known = ", ".join(sorted(GAZEBO_COLORS))
        missing.add("material", name, f"script of {owner}; known are Gazebo/ {known}")
    return color
