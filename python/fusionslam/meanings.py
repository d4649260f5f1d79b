# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What those values mean that are options of the command line and keys of the configuration too.

The command line answers ``--help`` before it can load the configuration, so both read this.
"""

SOURCE = (
    "lidar: the scan coloured by the left image; stereo: depth from both images; "
    "cloud: the scan as it is, with its own colours if it has any"
)
THRESHOLD = "largest descriptor distance that is accepted as a loop"
RADIUS = "two positions closer than this are one place, in metres"
LOOP_WINDOW = (
    "this many frames before the query are no candidates when loops are found "
    "(evaluation.window: when they are judged)"
)
EVALUATION_WINDOW = (
    "this many frames before the query are no candidates when loops are judged "
    "(loop_closure.window: when they are found)"
)
PROTOCOL = (
    "what recall is a share of: revisit (all revisits) or perdomo2019 (those whose nearest "
    "candidate is correct)"
)
