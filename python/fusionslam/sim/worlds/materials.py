# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Colours of SDF materials."""

import xml.etree.ElementTree as ET

from fusionslam.sim.worlds.missing_resources import Unresolved

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
        if written is not None:
            return _color(written, f"{key} of {owner}", missing)
    name = (material.findtext("script/name") or "").strip()
    if not name:
        return None
    color = GAZEBO_COLORS.get(name.removeprefix("Gazebo/"))
    if color is None:
        known = ", ".join(sorted(GAZEBO_COLORS))
        missing.add("material", name, f"script of {owner}; known are Gazebo/ {known}")
    return color


def _color(text: str, owner: str, missing: Unresolved) -> Color | None:
    try:
        red, green, blue = (float(number) for number in text.split()[:3])
    except ValueError:
        missing.add("material", owner, f"expected three or four numbers, found {text.strip()!r}")
        return None
    return red, green, blue
