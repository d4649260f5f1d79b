# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Base utilities: atomic files, caches, threads, types of arguments, words, the machine."""
