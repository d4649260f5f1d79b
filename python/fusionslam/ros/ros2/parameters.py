# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Parameters of ROS 2 nodes from the library's configuration."""

import sys
from collections.abc import Mapping
from typing import Any

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.node import Node
from rclpy.parameter import Parameter

from fusionslam.config import Section, limits_of, range_of, unit_of, walk

_OF_RCLPY = ("use_sim_time", "start_type_description_service")
_LARGEST = 2**63 - 1


def given_parameters(node: Node) -> dict[str, Any]:
    """Return the parameters that a node was started with, nested by name."""
    nested: dict[str, Any] = {}
    for name, parameter in node.get_parameters_by_prefix("").items():
        if name in _OF_RCLPY or name.startswith("qos_overrides."):
            continue
        *sections, key = name.split(".")
        inner = nested
        for section in sections:
            inner = inner.setdefault(section, {})
        value = parameter.value
        inner[key] = list(value) if isinstance(value, tuple) else value
    return nested


def declare_parameters(node: Node, config: Section) -> None:
    """Declare every value of a configuration, with its help and range; none can be set later."""
    for name, value, definition in walk(config):
        unit = unit_of(definition)
        descriptor = ParameterDescriptor(
            name=name,
            description=f"{definition.description}{f' [{unit}]' if unit else ''}",
            additional_constraints=range_of(definition),
            read_only=True,
            dynamic_typing=True,
            **_range(limits_of(definition), value),
        )
        if node.has_parameter(name):
            node.set_descriptor(name, descriptor)
        else:
            node.declare_parameter(name, _value_of(value), descriptor)


def _value_of(value: Any) -> Any:
    if value is None or (isinstance(value, tuple) and not value):
        return Parameter("none").value  # not set
    if isinstance(value, tuple):
        kinds = {type(each) for each in value}
        return list(value) if kinds in ({str}, {int}, {float}, {bool}) else str(value)
    return value if isinstance(value, bool | int | float | str) else str(value)


def _range(limits: Mapping[str, float], value: Any) -> dict[str, Any]:
    """Return the range of a number; ROS 2 has none that is open at one end."""
    low = limits.get("ge", limits.get("gt"))
    high = limits.get("le", limits.get("lt"))
    if (low is None and high is None) or isinstance(value, bool):
        return {}
    if isinstance(value, int):
        low, high = -_LARGEST if low is None else low, _LARGEST if high is None else high
        span = IntegerRange(from_value=int(low), to_value=int(high), step=0)
        return {"integer_range": [span]}
    if isinstance(value, float):
        least, most = -sys.float_info.max, sys.float_info.max
        low, high = least if low is None else float(low), most if high is None else float(high)
        return {"floating_point_range": [FloatingPointRange(from_value=low, to_value=high)]}
    return {}
