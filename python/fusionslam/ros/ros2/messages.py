# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Messages of ROS 2: made by rosidl, delivered by rclpy."""

import re
from array import array
from typing import Any

import numpy as np
from builtin_interfaces.msg import Duration, Time
from rclpy.serialization import deserialize_message

from fusionslam.errors import DataError
from fusionslam.ros.messages.library import MessageLibrary, message_class
from fusionslam.ros.ros2 import MESSAGES

_ELEMENT = re.compile(r"(?:sequence<(.*?)(?:, \d+)?>|(.*)\[\d+\])")
_CODES = {
    **{"uint8": "B", "octet": "B", "int8": "b", "uint16": "H", "int16": "h", "uint32": "I"},
    **{"int32": "i", "uint64": "Q", "int64": "q", "float": "f", "double": "d"},
}


def _field(value: Any) -> Any:
    """Return a field; arrays and bytes as arrays, which rclpy does not look through."""
    if isinstance(value, np.ndarray):
        return value.tolist() if value.dtype != np.uint8 else array("B", value.tobytes())
    return array("B", value) if isinstance(value, bytes) and len(value) != 1 else value


ROS2_MESSAGES = MessageLibrary(
    version=2,
    package=MESSAGES,
    advice="install its package, such as ros-jazzy-nav-msgs",
    time=lambda seconds, nanoseconds: Time(sec=seconds, nanosec=nanoseconds),
    duration=lambda seconds, nanoseconds: Duration(sec=seconds, nanosec=nanoseconds),
    field=_field,
    response=lambda service: service.Response,
)


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
    numbers = np.asarray(value, _CODES[element])
    is_fixed = found[2] is not None
    return numbers if is_fixed else array(_CODES[element], numbers.tobytes())
