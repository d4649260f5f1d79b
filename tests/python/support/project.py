# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Folders of the project."""

from pathlib import Path

PROJECT = Path(__file__).resolve().parents[3]
SUPPORT = PROJECT / "tests/python/support"
SMALL_DATA = PROJECT / "tests/data"
"""What a clone brings along."""
