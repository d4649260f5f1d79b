#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
# Runs the C++ tests beside the Python tests, which get the options given and whose closing line is
# the last one.
set -euo pipefail
cd "$(dirname "$0")/.."

scripts/cpp_tests.sh >build/cpp-tests.log 2>&1 &
cpp=$!
trap 'kill $cpp 2>/dev/null || true' EXIT

# One worker more than there are cores, since some tests wait for other processes.
workers=$(($(nproc) + 1))
# Plugins of pytest may import NumPy, whose BLAS reads these then, before conftest.py sets them.
export OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1
status=0
"${VENV:-.venv}/bin/python" -m pytest -n "$workers" --dist loadfile \
  --no-loadscope-reorder --durations 20 --durations-min 0.5 "$@" || status=$?
trap - EXIT
wait $cpp || { cat build/cpp-tests.log; echo "The C++ tests failed" >&2; exit 1; }
exit $status
