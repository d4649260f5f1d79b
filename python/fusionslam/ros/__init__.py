# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Nodes for ROS 1 and ROS 2: thin wrappers around the online objects of the library.

``nodes`` has a module for each node, ``runtime`` what all share and ``messages`` what they
publish: these know no middleware. ``ros1`` and ``ros2`` run them through ``runtime.transport``.
Nothing here is imported unless a node or one of the commands ``ros`` and ``ros2`` runs.
"""
