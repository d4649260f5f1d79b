# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Shared parts of all reports: the HTML page, tables, figures, embedded images."""
