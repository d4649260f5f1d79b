# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Sources of map exports: a finished run, or a map that still grows."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fusionslam.base.argument_types import checked
from fusionslam.base.arrays import Floats, Integers
from fusionslam.evaluation.maps.run import RatSlamRun
from fusionslam.ratslam.slam import RatSlam


@checked
@dataclass(frozen=True, eq=False, kw_only=True)
class LiveMap:
    """A snapshot of a ``RatSlam`` map, with the nodes in order of creation as its trajectory.

    Poses between the nodes are not kept: they would grow without bound.

    Attributes:
        name, views, odometry, preset, config: as in ``RatSlamRun``.
        nodes: float64 (k, 3), x, y in metres and heading in radians.
        node_stamps_ns: int64 (k), time of creation of each.
        node_views: int64 (k), the view it was created from.
        links: of dtype ``LINK``, in order of creation.
        stamps_ns, node_ids, view_ids, offsets, final_poses: those of the nodes; offsets are 0.
    """

    name: str
    views: str
    odometry: str
    preset: str
    config: Mapping[str, Any]
    nodes: Floats
    node_stamps_ns: Integers
    node_views: Integers
    links: NDArray[np.void]
    poses: None = None
    dead_reckoning: None = None
    truth: None = None

    @classmethod
    def of(cls, slam: RatSlam, name: str, odometry: str) -> "LiveMap":
        """Copy the map of a ``RatSlam``; the names of drive and odometry are for people."""
        with slam.paused():
            return cls(
                name=name,
                views="given ids" if slam.views is None else slam.views.title,
                odometry=odometry,
                preset=slam.preset,
                config=slam.config.model_dump(mode="json"),
                nodes=slam.map.nodes,
                node_stamps_ns=np.array(slam.memory.node_stamps_ns, np.int64),
                node_views=np.array(slam.memory.node_views, np.int64),
                links=slam.map.links,
            )

    @property
    def stamps_ns(self) -> Integers:
        return self.node_stamps_ns

    @property
    def node_ids(self) -> Integers:
        return np.arange(len(self.nodes))

    @property
    def view_ids(self) -> Integers:
        return self.node_views

    @property
    def offsets(self) -> Floats:
        return np.zeros_like(self.nodes)

    @property
    def final_poses(self) -> Floats:
        return self.nodes


MapRecord = RatSlamRun | LiveMap
"""A map and the trajectory on it; a ``LiveMap`` has None for trajectories that were not kept."""
