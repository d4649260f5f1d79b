# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Messages of ROS 1: made by genpy, delivered by rospy."""

from typing import Any

import numpy as np
from genpy import Duration, Time

from fusionslam.errors import DataError
from fusionslam.ros.messages.library import OWN, MessageLibrary, message_class
from fusionslam.ros.runtime.node import Delivery


def _packed(value: Any) -> Any:
    """Return a field; those that genpy packs as bytes must be bytes."""
    is_bytes = isinstance(value, np.ndarray) and value.dtype == np.uint8
    return value.tobytes() if is_bytes else value


ROS1_MESSAGES = MessageLibrary(
    version=1,
    package=OWN,
    advice="make ros installs it",
    time=Time,
    duration=Duration,
    field=_packed,
    response=lambda service: service._response_class,
)


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
        try:
            return kind().deserialize(message._buff)
        except Exception as error:  # genpy raises exceptions of many types
            raise DataError(
                f"no {type_name}, or cut short: {error}; check its publisher", code="cut-short"
            ) from error

    return Delivery(found, str(header.get("callerid", "unknown")), len(message._buff), read)
