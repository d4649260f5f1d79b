# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Descriptors by name, all with the same configuration.

A name may end with a preset, "cm2dp:author", which then replaces that of the configuration. Only
the registry is imported at once; the rest with its first use.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from fusionslam.descriptors.registry import DESCRIPTORS as DESCRIPTORS
from fusionslam.descriptors.registry import GROUPS as GROUPS
from fusionslam.descriptors.registry import NAMES as NAMES
from fusionslam.descriptors.registry import PRESETS as PRESETS
from fusionslam.descriptors.registry import USUAL as USUAL
from fusionslam.descriptors.registry import Descriptor as Descriptor

if TYPE_CHECKING:
    from fusionslam.descriptors.computation import describe as describe
    from fusionslam.descriptors.computation import describe_or_zeros as describe_or_zeros
    from fusionslam.descriptors.computation import find_descriptor as find_descriptor
    from fusionslam.descriptors.computation import for_clouds as for_clouds
    from fusionslam.descriptors.computation import for_preset as for_preset
    from fusionslam.descriptors.computation import for_sequence as for_sequence
    from fusionslam.descriptors.computation import in_file_names as in_file_names
    from fusionslam.descriptors.computation import length_of as length_of
    from fusionslam.descriptors.computation import load_descriptor as load_descriptor
    from fusionslam.descriptors.computation import missing_data as missing_data
    from fusionslam.descriptors.computation import needs_up as needs_up
    from fusionslam.descriptors.computation import with_fitted as with_fitted
    from fusionslam.descriptors.computation import with_preset as with_preset
    from fusionslam.descriptors.computation import without_colors as without_colors
    from fusionslam.descriptors.computation import without_fitted as without_fitted
    from fusionslam.descriptors.config import DescriptorConfig as DescriptorConfig
    from fusionslam.descriptors.own import find_own as find_own
    from fusionslam.descriptors.own import is_own as is_own
    from fusionslam.descriptors.own import own_files as own_files


_HOMES = {
    "computation": (
        "describe describe_or_zeros find_descriptor for_clouds for_preset for_sequence "
        "in_file_names length_of load_descriptor missing_data needs_up with_fitted with_preset "
        "without_colors without_fitted"
    ),
    "config": "DescriptorConfig",
    "own": "find_own is_own own_files",
}
_HOME_OF = {name: home for home, names in _HOMES.items() for name in names.split()}


def __getattr__(name: str) -> Any:
    if name not in _HOME_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(f"{__name__}.{_HOME_OF[name]}"), name)
    globals()[name] = value
    return value
