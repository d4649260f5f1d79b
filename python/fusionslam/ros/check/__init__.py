# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""``fusionslam ros check``: can the nodes work with what a robot publishes?"""
