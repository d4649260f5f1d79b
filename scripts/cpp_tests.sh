#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
# Builds the C++ tests in build/cpp and runs them.
set -euo pipefail
cd "$(dirname "$0")/.."
source scripts/ccache.sh
cmake -S . -B build/cpp -G Ninja -DCMAKE_BUILD_TYPE=Release >build/cpp-configure.log 2>&1 ||
  { cat build/cpp-configure.log; exit 1; }
cmake --build build/cpp
ctest --test-dir build/cpp --output-on-failure
