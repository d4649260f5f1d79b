# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What all reports share: the HTML page, tables, figures, embedded images."""
