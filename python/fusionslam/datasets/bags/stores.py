# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Message types of ROS 1 and ROS 2, from rosbags."""

import functools
from typing import TYPE_CHECKING, Any, Literal

from fusionslam.datasets.bags.decompression import bound_decompression
from fusionslam.errors import DataError

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

KINDS = ("rosbag1", "rosbag2", "mcap")
"""ROS 1 file, ROS 2 folder with an SQLite database, ROS 2 MCAP file or folder."""

_TRANSFORMS = "geometry_msgs/TransformStamped[] transforms\n"


def need_rosbags() -> None:
    """Raise DataError that says what to install if rosbags is missing."""
    try:
        import rosbags.rosbag1  # noqa: F401
    except ImportError as error:
        message = "bags need rosbags: pip install 'fusionslam[bags]'"
        raise DataError(message, code="missing-extra", fields=("bags",)) from error
    bound_decompression()


@functools.cache
def type_store(ros: Literal[1, 2]) -> "Typestore":
    """Message types of ROS 1 or 2; the definitions used here never changed within either."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC if ros == 1 else Stores.ROS2_HUMBLE)
    # rosbags' ROS 1 types lack those of tf2 and of tf, its predecessor.
    for name in ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage"):
        if name not in store.fielddefs:
            store.register(get_types_from_msg(_TRANSFORMS, name))
    return store


def make_in(store: "Typestore") -> Any:
    """Return a function that builds messages of a type store, for ``MessageBuilder``."""

    def make(type_name: str, /, **fields: Any) -> Any:
        return store.types[type_name](**fields)

    return make
