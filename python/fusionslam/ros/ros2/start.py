# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Run the nodes in ROS 2."""

import logging
import re
import signal
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from fusionslam.errors import ConfigError
from fusionslam.ros.nodes import node_class
from fusionslam.ros.ros2.environment import need_ros2
from fusionslam.ros.runtime.problem_log import RosHandler
from fusionslam.ros.runtime.runner import NodeRunner, exit_on_errors


def start(name: str, arguments: Sequence[str] = ()) -> None:
    """Run a node until it is interrupted.

    Args:
        name: one of ``NODES``.
        arguments: for ROS, as ``--ros-args -r odom:=/wheels/odom -p fusion.voxel:=0.05``.

    Raises:
        SystemExit: 2 if the node cannot start, 130 if it is interrupted while starting.
    """
    with exit_on_errors(name, with_dots):
        need_ros2()
        _run(name, arguments)


def _run(name: str, arguments: Sequence[str]) -> None:
    from fusionslam.ros.ros2.parameters import declare_parameters
    from fusionslam.ros.ros2.transport import Ros2Transport

    kind, is_ending = node_class(name), threading.Event()
    with ros2_node(kind.name, arguments, is_ending) as node:
        handler = RosHandler(lambda level, text: _log(node, level, text))
        library = logging.getLogger("fusionslam")
        library.addHandler(handler)
        logging.getLogger("fusionslam.ros").setLevel(logging.INFO)
        transport = Ros2Transport(node, is_ending)
        try:
            runner = NodeRunner(kind, transport)
            handler.problems = runner.problems
            declare_parameters(node, runner.config)
            heard = ", ".join(transport.full_name(topic) for topic in runner.inputs)
            _log(node, logging.INFO, f"{kind.name} is ready: it listens to {heard}")
            runner.run()
        finally:
            library.removeHandler(handler)
            transport.close()


@contextmanager
def ros2_node(
    name: str, arguments: Sequence[str], is_ending: threading.Event | None = None
) -> Iterator[Any]:
    """Make a node of rclpy; SIGINT and SIGTERM set ``is_ending``, or act as in any Python.

    Raises:
        ConfigError: an argument that is not one of ROS 2.
    """
    import rclpy
    from rclpy.exceptions import ParameterException
    from rclpy.signals import SignalHandlerOptions
    from rclpy.utilities import remove_ros_args

    if is_ending is not None:
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, lambda *_: is_ending.set())
    try:
        others = remove_ros_args([name, *arguments])[1:]
        rclpy.init(args=[name, *arguments], signal_handler_options=SignalHandlerOptions.NO)
        node = rclpy.create_node(name, automatically_declare_parameters_from_overrides=True)
    except (RuntimeError, ValueError, ParameterException) as error:
        rclpy.try_shutdown()
        reason, _, _ = str(error).partition(", at /")  # a place in rcl's source
        raise ConfigError(
            f"ROS 2 does not start: {type(error).__name__}: {' '.join(reason.split())}"
        ) from error
    try:
        _check_arguments(others)
        yield node
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


def _check_arguments(others: Sequence[str]) -> None:
    if not others:
        return
    cure = "--ros-args -r FROM:=TO -p NAME:=VALUE"
    if others[0].startswith("_") or ":=" in others[0]:
        cure = f"ROS 2 takes --ros-args {'-p' if others[0].startswith('_') else '-r'} before it"
    raise ConfigError(
        f"{others[0]!r} is no argument of ROS 2: {cure}",
        code="no-ros-argument",
        fields=(others[0],),
    )


def with_dots(text: str) -> str:
    """Return a text with names of parameters as ROS 2 writes them: fusion.voxel."""
    return re.sub(r"~(\w[\w/.]*\w|\w)", lambda found: found[1].replace("/", "."), text)


def _log(node: Any, level: int, text: str) -> None:
    console, text = node.get_logger(), with_dots(text)
    if level < logging.WARNING:
        console.info(text)
    elif level == logging.WARNING:
        console.warning(text)
    else:
        console.error(text)
