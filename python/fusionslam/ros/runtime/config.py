# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The configuration shared by all nodes, and its values from ROS parameters."""

import re
from collections.abc import Mapping
from typing import Any, Literal, TypeVar

from fusionslam.config import Section, merged, option
from fusionslam.errors import ConfigError


class NodeConfig(Section):
    """Configuration shared by all nodes."""

    queue: int = option(
        100,
        "largest number of waiting messages of a topic; older ones are dropped and counted",
        ge=1,
    )
    stamps: Literal["header", "arrival"] = option(
        "header", "time of a message: the stamp of its header, or its arrival"
    )
    idle: float = option(
        1.0,
        "after such a silence of all topics, waiting messages are processed as they are, and files "
        "are written",
        unit="s",
        gt=0,
    )
    only_one: float = option(
        2.0,
        "a second publisher of a topic is used once the first has been silent for this time",
        unit="s",
        gt=0,
    )
    patience: float = option(
        10.0,
        "after this time (wall clock) the node names topics without messages",
        unit="s",
        gt=0,
    )
    report: float = option(1.0, "time between two reports on /diagnostics", unit="s", gt=0)


class CommonConfig(Section):
    """Base class of the configuration of every node."""

    node: NodeConfig = option(NodeConfig(), "queues, stamps and reports")


C = TypeVar("C", bound=Section)


def from_parameters(defaults: C, parameters: Mapping[str, Any]) -> C:
    """Return a node's configuration with the values of its private ROS parameters.

    Args:
        defaults: of the node.
        parameters: nested by name: ``~fusion/voxel`` is {"fusion": {"voxel": ...}}; the parameter
            server has no None, which is written as the text "null".

    Raises:
        ConfigError: an unknown name (the message suggests the nearest), a wrong type, or a value
            out of range.
    """
    try:
        return merged(defaults, _with_none(parameters), "~")
    except ConfigError as error:
        # ROS uses slashes where files use dots.
        text = re.sub(r"~[\w.]+", lambda key: key[0].replace(".", "/"), str(error))
        raise ConfigError(text.replace("configuration key", "parameter")) from error


def _with_none(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _with_none(inner) for key, inner in value.items()}
    return None if value == "null" else value
