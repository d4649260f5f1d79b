#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
# Installs what the ROS nodes need of Debian 12. The next build of fusionslam (scripts/setup.sh)
# makes their messages.
set -euo pipefail
cd "$(dirname "$0")/.."
mapfile -t packages < <(grep -v '^#' python/fusionslam/ros/ros1/debian_packages.txt)
scripts/debian.sh "${packages[@]}"
