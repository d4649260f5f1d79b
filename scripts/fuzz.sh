#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
# Tries hostile inputs on all targets of fuzz/: fuzz.sh [OPTION of python -m fuzz]...
# With --core the readers of the C++ core, too, under libFuzzer and the sanitizers (needs clang).
set -euo pipefail
cd "$(dirname "$0")/.."
bin=${VENV:-.venv}/bin

wanted=$("$bin/python" -c 'import tomllib; print(*tomllib.load(open("pyproject.toml", "rb"))["project"]["optional-dependencies"]["fuzz"])')
# shellcheck disable=SC2086  # one requirement a word
"$bin/python" -m pip install --quiet --disable-pip-version-check $wanted

if [ "${1:-}" = --core ]; then
  shift
  scripts/debian.sh clang-16 libclang-rt-16-dev
  flags="-fsanitize=fuzzer-no-link,address,undefined -fno-sanitize-recover=all"
  # PCL was built without a sanitizer: its Eigen and ours must take and free memory the same way.
  flags+=" -fno-omit-frame-pointer -DEIGEN_MALLOC_ALREADY_ALIGNED=1"
  cmake -S . -B build/fuzz -G Ninja -DCMAKE_C_COMPILER=clang-16 -DCMAKE_CXX_COMPILER=clang++-16 \
    -DCMAKE_CXX_FLAGS="$flags" -DCMAKE_INTERPROCEDURAL_OPTIMIZATION=OFF -DBUILD_TESTING=OFF \
    -DCMAKE_BUILD_TYPE=Debug -DCMAKE_CXX_FLAGS_DEBUG="-O1 -DNDEBUG" -DFUSIONSLAM_FUZZ=ON \
    >build/fuzz-configure.log 2>&1 || { cat build/fuzz-configure.log; exit 1; }
  cmake --build build/fuzz
fi
OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1 "$bin/python" -m fuzz "$@"
