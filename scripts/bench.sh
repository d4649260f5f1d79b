#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
# Installs and builds what the benchmark compares with, then runs it with the given options.
set -euo pipefail
cd "$(dirname "$0")/.."

source scripts/ccache.sh
log=build/bench-build.log
{
  cmake -S . -B build/bench -G Ninja -DCMAKE_BUILD_TYPE=Release -DBUILD_TESTING=OFF \
    -DFUSIONSLAM_BENCHMARKS=ON -DPython_EXECUTABLE="$PWD/.venv/bin/python" \
    -Dpybind11_DIR="$(.venv/bin/pybind11-config --cmakedir)" &&
    cmake --build build/bench --target fusionslam_peers
} >"$log" 2>&1 || { cat "$log"; exit 1; }

PYTHONPATH=build/bench exec .venv/bin/python -m benchmarks.speed "$@"
