# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Fixtures of all tests of this stage."""

from map_fixtures import *  # noqa: F403
