# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Files written whole, caches, threads and the machine: the ground that everything stands on."""
