# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The message classes of the ROS that this process runs with."""

import functools
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import Any, Literal

from fusionslam.datasets.bags.messages import MessageBuilder, plain_type
from fusionslam.errors import DataError
from fusionslam.sensors.messages import NANOSECONDS, Message

OWN = "fusionslam_ros"
"""Package of our own messages, as type names here have it."""


@dataclass(frozen=True)
class MessageLibrary:
    """What the messages of ROS 1 and ROS 2 differ in.

    Attributes:
        version: of ROS.
        package: of our own messages.
        advice: how to install missing types.
        time: makes a time of seconds and nanoseconds.
        duration: makes a duration of them, which may be negative.
        field: returns a field as message classes take it.
        response: returns the class of a service's responses.
    """

    version: Literal[1, 2]
    package: str
    advice: str
    time: Callable[[int, int], Any]
    duration: Callable[[int, int], Any]
    field: Callable[[Any], Any]
    response: Callable[[type[Any]], type[Any]]


_in_use: list[MessageLibrary] = []


def use_messages(library: MessageLibrary) -> None:
    """Set the messages of this process: those of one ROS, once."""
    if _in_use and _in_use[0].version != library.version:
        raise RuntimeError("a process speaks either ROS 1 or ROS 2")
    _in_use[:] = [library]


def message_class(type_name: str) -> type[Any]:
    """Return the class of a type like "nav_msgs/Odometry". Raises DataError if not installed."""
    return _find_class(plain_type(type_name), "msg")


def service_class(type_name: str) -> type[Any]:
    """Return the class of a type like "std_srvs/Empty". Raises DataError if not installed."""
    return _find_class(type_name, "srv")


def own_type(type_name: str) -> str:
    """Return the name here of a type as the ROS in use has it: "nav_msgs/Odometry"."""
    package, _, name = plain_type(type_name).partition("/")
    return f"{OWN if package == _library().package else package}/{name}"


def shown_type(type_name: str) -> str:
    """Return a type as users of the ROS in use know it; the opposite of ``own_type``."""
    package, _, name = type_name.partition("/")
    return f"{_library().package if package == OWN else package}/{name}"


def make(type_name: str, /, **fields: Any) -> Any:
    """Make a message from its fields."""
    library = _library()
    if type_name.startswith("builtin_interfaces/"):
        return library.time(fields["sec"], fields["nanosec"])
    return message_class(type_name)(**{key: library.field(fields[key]) for key in fields})


def build(value: Message, stored: str = "raw") -> Any:
    """Make a message of a scan, image, calibration, odometry or transforms.

    Raises DataError as ``MessageBuilder.build``.
    """
    return MessageBuilder(make, ros=_library().version).build(value, stored)


def respond(type_name: str, **fields: Any) -> Any:
    """Make the response of a service from its fields."""
    return _library().response(service_class(type_name))(**fields)


def ros_time(stamp_ns: int) -> Any:
    """Return a time stamp."""
    return _library().time(*divmod(int(stamp_ns), NANOSECONDS))


def ros_duration(nanoseconds: int) -> Any:
    """Return a duration, which may be negative."""
    return _library().duration(*divmod(int(nanoseconds), NANOSECONDS))


def _library() -> MessageLibrary:
    return _in_use[0]


@functools.cache
def _find_class(type_name: str, kind: str) -> type[Any]:
    package, _, name = shown_type(type_name).partition("/")
    module = f"{package}.{kind}"
    try:
        return getattr(import_module(module), name)  # type: ignore[no-any-return]
    except (ImportError, AttributeError):
        raise DataError(
            f"the type {type_name} is not installed: {_library().advice}",
            code="no-ros-type",
            fields=(type_name,),
        ) from None
