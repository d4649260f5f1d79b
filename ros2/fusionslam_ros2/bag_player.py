#!/usr/bin/env python3
# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
import sys

from fusionslam.__main__ import main

sys.argv[1:1] = ["ros2", "play"]
main()
