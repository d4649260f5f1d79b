# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The embedded drive: a procedural town, the car that drives through it, and its recording."""
