# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Whole recordings, start to end: each command of the command line calls one of these modules."""
