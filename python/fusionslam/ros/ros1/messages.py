# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Messages of ROS 1: made by genpy, delivered by rospy."""

from typing import Any, Literal

import numpy as np

from fusionslam.errors import DataError
from fusionslam.ros.messages.library import OWN, message_class
from fusionslam.ros.runtime.transport import Delivery


class Ros1Messages:
    """As ``MessageLibrary``."""

    version: Literal[1] = 1
    package = OWN
    advice = "make ros installs it"

    def time(self, seconds: int, nanoseconds: int) -> Any:
        """As ``MessageLibrary``."""
        from genpy import Time

        return Time(seconds, nanoseconds)

    def duration(self, seconds: int, nanoseconds: int) -> Any:
        """As ``MessageLibrary``."""
        from genpy import Duration

        return Duration(seconds, nanoseconds)

    def field(self, value: Any) -> Any:
        """As ``MessageLibrary``; fields that genpy packs as bytes must be bytes."""
        is_bytes = isinstance(value, np.ndarray) and value.dtype == np.uint8
        return value.tobytes() if is_bytes else value

    def response(self, service: type[Any]) -> type[Any]:
        """As ``MessageLibrary``."""
        return service._response_class  # type: ignore[no-any-return]


def delivery_of(message: Any) -> Delivery:
    """Return a message delivered as rospy's AnyMsg."""
    header = message._connection_header
    found = str(header.get("type", "unknown"))

    def read(type_name: str = found) -> Any:
        kind = message_class(type_name)
        if type_name == found and header.get("md5sum", kind._md5sum) not in (kind._md5sum, "*"):
            raise DataError(
                f"its publisher has another definition of {found}: build both from the same "
                "version",
                code="other-definition",
                fields=(found,),
            )
        return _deserialize(message._buff, type_name)

    return Delivery(found, str(header.get("callerid", "unknown")), len(message._buff), read)


def _deserialize(data: bytes, type_name: str) -> Any:
    try:
        return message_class(type_name)().deserialize(data)
    except Exception as error:  # genpy raises exceptions of many types
        raise DataError(
            f"no {type_name}, or cut short: {error}; check its publisher", code="cut-short"
        ) from error
