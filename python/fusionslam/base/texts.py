# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Words that several modules need: counts, and help of options that are configuration keys, too.

The command line answers ``--help`` before it can load the configuration, so both read it here.
"""

from collections.abc import Iterable
from itertools import islice


def counted(count: int, noun: str, form: str = "") -> str:
    """Return a count with its noun, which takes an s unless the count is 1: "1 frame"."""
    plural = f"{noun[:-1]}ies" if noun.endswith("ry") else f"{noun}s"
    return f"{count:{form}} {noun if count == 1 else plural}"


def listed(items: Iterable[object], most: int = 8) -> str:
    """Return the first items, and dots if there are more: "3, 5, ..."."""
    first = [str(item) for item in islice(items, most + 1)]
    return ", ".join([*first[:most], *(["..."] if len(first) > most else [])])


PER_FRAME = "per_frame"
"""Attribute of a log record that holds its message without the frame: commands count these."""

SOURCE = (
    "lidar: the scan coloured by its cameras; stereo: depth from both images; "
    "cloud: the scan as it is, with its own colours if it has any"
)
CLOUD_FRAME = (
    "what frame clouds are in: scan; camera (the left one, rectified: z ahead, y down); robot; "
    "odometry, which needs the robot's motion"
)
GROUND = (
    "how the ground is removed: none; height: a threshold; plane: RANSAC; segments: planes fitted "
    "from the lowest points up along the driving axis. In the cloud's frame, but camera: the "
    "scan's; odometry with segments: the robot's"
)
THRESHOLD = (
    "largest descriptor distance that is accepted as a loop; by default (null) the one fitted to "
    "descriptor, preset and source on simulated towns"
)
RADIUS = "two positions closer than this are one place, in metres; by default the protocol's"
LOOP_WINDOW = (
    "this many frames before the query are no candidates when loops are found "
    "(evaluation.window: when they are judged)"
)
EVALUATION_WINDOW = (
    "this many frames before the query are no candidates when loops are judged, by default the "
    "protocol's (loop_closure.window: when they are found)"
)
PROTOCOL = (
    "what must be right: the place (revisit: recall of all revisits; perdomo2019: of those whose "
    "nearest candidate is right) or, of verified loops, the pose (pose-1m-5deg, pose-2m-5deg); or "
    "what another paper judges, with its radius and window unless they are given: pairs of scans "
    "(ssc: 3 m), or matches (scancontext: 4 m; solid: 10 m, 100 frames)"
)
