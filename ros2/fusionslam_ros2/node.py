#!/usr/bin/env python3
# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
# Installed once for each node, under its name.
import sys
from pathlib import Path

from fusionslam.ros.ros2.start import start

start(Path(sys.argv[0]).name, sys.argv[1:])
