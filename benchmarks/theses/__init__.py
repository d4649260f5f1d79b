# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Both theses measured again, on one page: ``python -m benchmarks.theses``."""
