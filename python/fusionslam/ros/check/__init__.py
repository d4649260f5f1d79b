# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""``fusionslam ros check``: check that the nodes can work with a robot's topics."""
