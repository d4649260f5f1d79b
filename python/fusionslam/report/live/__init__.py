# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Live views: a growing map in rerun, and everything in Foxglove."""
