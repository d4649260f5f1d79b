# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What launch files of ROS 2 import, which no wheels have: actions that keep their arguments.

Their signatures are those of launch and launch_ros, as far as our launch files use them.
"""

import runpy
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest


@dataclass(frozen=True)
class DeclareLaunchArgument:
    """An argument; without a default it has to be given."""

    name: str
    default_value: str | None = field(kw_only=True)
    description: str = field(kw_only=True)
    choices: Sequence[str] | None = field(kw_only=True)


@dataclass(frozen=True, kw_only=True)
class OpaqueFunction:
    """A function that returns further actions."""

    function: Callable[["LaunchContext"], list[Any]]


@dataclass(frozen=True)
class PythonLaunchDescriptionSource:
    """A launch file in Python."""

    path: str


@dataclass(frozen=True)
class IncludeLaunchDescription:
    """Another launch file, with all that is configured here."""

    source: PythonLaunchDescriptionSource


@dataclass(frozen=True, kw_only=True)
class Shutdown:
    """The end of the launch."""

    reason: str


@dataclass(frozen=True, kw_only=True)
class Node:
    """A node that is started."""

    package: str
    executable: str
    name: str
    output: str = "log"
    arguments: Sequence[str] = ()
    parameters: Sequence[str | Mapping[str, Any]] = ()
    remappings: Sequence[tuple[str, str]] = ()
    on_exit: Sequence[Any] = ()


@dataclass(frozen=True)
class LaunchDescription:
    """What a launch file returns."""

    entities: Sequence[Any]


@dataclass(frozen=True)
class LaunchContext:
    """The values of the arguments."""

    launch_configurations: dict[str, str]


MODULES: dict[str, dict[str, Any]] = {
    "launch": {
        "LaunchContext": LaunchContext,
        "LaunchDescription": LaunchDescription,
        "LaunchDescriptionEntity": object,
    },
    "launch.actions": {
        each.__name__: each
        for each in (DeclareLaunchArgument, IncludeLaunchDescription, OpaqueFunction, Shutdown)
    },
    "launch.launch_description_sources": {
        "PythonLaunchDescriptionSource": PythonLaunchDescriptionSource
    },
    "launch_ros": {},
    "launch_ros.actions": {"Node": Node},
    "ament_index_python": {},
    "ament_index_python.packages": {"get_package_share_directory": "/share/{}".format},
}


def use_stand_in(patch: pytest.MonkeyPatch, package: Path) -> None:
    """Let launch files import the stand-ins, and their package from its source."""
    for name, content in MODULES.items():
        module = ModuleType(name)
        vars(module).update(content)
        patch.setitem(sys.modules, name, module)
    patch.syspath_prepend(package)


def describe(path: Path) -> LaunchDescription:
    """Return the description in a launch file."""
    description: LaunchDescription = runpy.run_path(str(path))["generate_launch_description"]()
    return description


def launch(path: Path, given: Mapping[str, str]) -> list[Node]:
    """Return the nodes that a launch file starts."""
    return _visit(describe(path).entities, LaunchContext(dict(given)))


def _visit(entities: Sequence[Any], context: LaunchContext) -> list[Node]:
    nodes: list[Node] = []
    values = context.launch_configurations
    for each in entities:
        if isinstance(each, DeclareLaunchArgument):
            if each.default_value is not None:
                values.setdefault(each.name, each.default_value)
            assert not each.choices or values[each.name] in each.choices, each
        elif isinstance(each, OpaqueFunction):
            nodes += _visit(each.function(context), context)
        elif isinstance(each, IncludeLaunchDescription):
            nodes += _visit(describe(Path(each.source.path)).entities, context)
        else:
            assert isinstance(each, Node), each
            nodes.append(each)
    return nodes
