# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What a ``RatSlam`` remembers beside its cells and its map."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from fusionslam.ratslam.odometer import Odometry2D
from fusionslam.views.matches import NO_VIEW


@dataclass
class Memory:
    """What a ``RatSlam`` remembers beside its cells and its map.

    Attributes:
        odometry: the last that was said.
        newest_ns: stamp of the newest event.
        looked_ns: stamp of the last view, recognised or not.
        view: id of the last one that was recognised; -1 before the first.
        moved: whether odometry has said yet how the robot moved.
        node_stamps_ns, node_views: of each node, when and of which view it was made.
    """

    odometry: Odometry2D | None = None
    newest_ns: int | None = None
    looked_ns: int | None = None
    view: int = NO_VIEW
    moved: bool = False
    node_stamps_ns: list[int] = field(default_factory=list)
    node_views: list[int] = field(default_factory=list)

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> "Memory":
        """Of what ``asdict`` and JSON make of one."""
        said = values["odometry"]
        if said is not None:
            stamp_ns, pose, speed = said
            said = Odometry2D(stamp_ns, pose and tuple(pose), speed and tuple(speed))
        return cls(**{**values, "odometry": said})
