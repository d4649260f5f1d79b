# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""ROS 1 nodes: thin wrappers around the online objects of the library.

``runtime.node`` holds what all nodes share and ``launch.start`` runs one; each node has its own
module in ``nodes``. Nothing here is imported unless a node or the command ``fusionslam ros`` runs.
"""
