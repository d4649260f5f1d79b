# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""ROS 1 nodes: thin shells around the online objects of the library.

``node`` is what all of them have in common, ``start`` runs one of them; each node has a module of
its own in ``nodes``. Nothing here is imported unless a node or the command ``fusionslam ros`` runs.
"""
