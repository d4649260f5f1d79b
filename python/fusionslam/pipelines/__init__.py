# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Process whole recordings: each command of the command line calls one of these modules."""
