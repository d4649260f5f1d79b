# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Messages of ROS 2: made by rosidl, delivered by rclpy."""

import re
from array import array
from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
from rclpy.serialization import deserialize_message

from fusionslam.errors import DataError
from fusionslam.ros.messages.library import message_class
from fusionslam.ros.ros2 import MESSAGES

_ELEMENT = re.compile(r"(?:sequence<(.*?)(?:, \d+)?>|(.*)\[\d+\])")
_CODES = {
    **{"uint8": "B", "octet": "B", "int8": "b", "uint16": "H", "int16": "h", "uint32": "I"},
    **{"int32": "i", "uint64": "Q", "int64": "q", "float": "f", "double": "d"},
}


class Ros2Messages:
    """As ``MessageLibrary``."""

    version: Literal[2] = 2
    package = MESSAGES
    advice = "install its package, such as ros-jazzy-nav-msgs"

    def time(self, seconds: int, nanoseconds: int) -> Any:
        """As ``MessageLibrary``."""
        from builtin_interfaces.msg import Time

        return Time(sec=seconds, nanosec=nanoseconds)

    def duration(self, seconds: int, nanoseconds: int) -> Any:
        """As ``MessageLibrary``."""
        from builtin_interfaces.msg import Duration

        return Duration(sec=seconds, nanosec=nanoseconds)

    def field(self, value: Any) -> Any:
        """As ``MessageLibrary``; arrays and bytes as arrays, which rclpy does not look through."""
        if isinstance(value, np.ndarray):
            return value.tolist() if value.dtype != np.uint8 else array("B", value.tobytes())
        return array("B", value) if isinstance(value, bytes) and len(value) != 1 else value

    def response(self, service: type[Any]) -> type[Any]:
        """As ``MessageLibrary``."""
        return service.Response  # type: ignore[no-any-return]


def deserialize(data: bytes, type_name: str) -> Any:
    """Deserialise a message. Raises DataError."""
    try:
        return deserialize_message(data, message_class(type_name))
    except Exception as error:  # rclpy raises exceptions of several types
        raise DataError(
            f"no {type_name}, or cut short: {error}; check its publisher", code="cut-short"
        ) from error


def convert(message: Any, type_name: str) -> Any:
    """Return a message that another library read from a bag, of ROS 1 or ROS 2, as rclpy's.

    Raises:
        DataError: the type is not installed, or has other fields here (code "other-definition").
    """
    kind = message_class(type_name)
    converted = kind()
    for name, field in kind.get_fields_and_field_types().items():
        # ROS 1 has a few fields in capital letters, as K of CameraInfo.
        source = name if hasattr(message, name) else name.upper()
        try:
            setattr(converted, name, _convert_field(getattr(message, source), field))
        except (AttributeError, AssertionError, TypeError, ValueError, OverflowError) as error:
            raise DataError(
                f"field '{name}' of {type_name} is not the one of the type installed here: {error}",
                code="other-definition",
                fields=(type_name, name),
            ) from error
    return converted


def _convert_field(value: Any, type_name: str) -> Any:
    found = _ELEMENT.fullmatch(type_name)
    if found is None:
        if "/" in type_name:
            return convert(value, type_name)
        return bytes([value]) if type_name == "octet" else value
    element = found[1] or found[2]
    if "/" in element:
        return [convert(each, element) for each in value]
    if element not in _CODES:
        return list(value)
    return _numbers(value, _CODES[element], fixed=found[2] is not None)


def _numbers(values: Sequence[Any], code: str, *, fixed: bool) -> Any:
    numbers = np.asarray(values, code)
    return numbers if fixed else array(code, numbers.tobytes())
