# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""All targets by name."""

from fuzz.foreign_files import foreign_file_targets
from fuzz.place_maps import place_map_targets
from fuzz.public_functions import public_function_targets
from fuzz.stored_formats import stored_format_targets
from fuzz.target import Target


def all_targets() -> dict[str, Target]:
    """Every target; the part of a name before the slash is its group."""
    found = [
        *stored_format_targets(),
        *place_map_targets(),
        *foreign_file_targets(),
        *public_function_targets(),
    ]
    return {target.name: target for target in found}


def find_target(name: str) -> Target:
    """A target by its name. Raises KeyError."""
    return all_targets()[name]
