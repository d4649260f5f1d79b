# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Reproduction of both theses on one page: ``python -m benchmarks.theses``."""
