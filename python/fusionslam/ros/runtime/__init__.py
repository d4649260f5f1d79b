# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The runtime of every node: queues, threads, diagnostics, files, logging."""
