# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Live views: a growing map in rerun, and everything in Foxglove."""

HOST, PORT = "127.0.0.1", 8765
"""What the server of Foxglove's viewers listens on unless told otherwise: this machine alone."""
