#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
# Runs the C++ tests and the Python tests of the bindings under AddressSanitizer and
# UndefinedBehaviorSanitizer, and the C++ tests of threads under ThreadSanitizer. Any finding ends
# the run. With --threads only the latter. With --quick only the tests of the bindings: the builds
# for the C++ tests take nearly half of the time, and make nightly runs them.
set -euo pipefail
cd "$(dirname "$0")/.."

source scripts/ccache.sh
python=$PWD/.venv/bin/python

test_threads() {
  local build
  # A program of its own: fusionslam-tests would take minutes more to build.
  build=build/sanitize-threads
  cmake -S . -B $build -G Ninja -DCMAKE_CXX_FLAGS="-fsanitize=thread" \
    -DCMAKE_INTERPROCEDURAL_OPTIMIZATION=OFF -DCMAKE_BUILD_TYPE=Debug \
    -DCMAKE_CXX_FLAGS_DEBUG="-O1 -DNDEBUG" >$build-configure.log 2>&1 ||
    { cat $build-configure.log; exit 1; }
  cmake --build $build --target fusionslam-thread-tests
  echo "C++ tests of threads under ThreadSanitizer"
  # Its shadow memory needs addresses that are not chosen at random. Nothing is suppressed.
  TSAN_OPTIONS=halt_on_error=1 setarch --addr-no-randomize $build/tests/cpp/fusionslam-thread-tests
}

case ${1:-} in
  --threads) test_threads; exit ;;
  --quick) targets=(_core) ;;
  *) test_threads; targets=(_core fusionslam-tests) ;;
esac

build=build/sanitize
flags="-fsanitize=address,undefined -fno-sanitize-recover=all -fno-omit-frame-pointer"
# PCL was built without a sanitizer: its Eigen and ours must take and free memory the same way.
flags+=" -DEIGEN_MALLOC_ALREADY_ALIGNED=1"
# Python itself leaves memory to the end of the process.
export ASAN_OPTIONS=detect_leaks=0 UBSAN_OPTIONS=print_stacktrace=1

# Lightly optimised: -O3 and link-time optimisation take more time here than they save.
cmake -S . -B $build -G Ninja -DCMAKE_CXX_FLAGS="$flags" -DCMAKE_INTERPROCEDURAL_OPTIMIZATION=OFF \
  -DCMAKE_BUILD_TYPE=Debug -DCMAKE_CXX_FLAGS_DEBUG="-O1 -DNDEBUG" \
  -DFUSIONSLAM_BINDINGS=ON -Dpybind11_DIR="$("$python" -m pybind11 --cmakedir)" \
  -DPython_EXECUTABLE="$python" >$build-configure.log 2>&1 ||
  { cat $build-configure.log; exit 1; }
cmake --build $build --target "${targets[@]}"

if [ "${1:-}" != --quick ]; then
  echo "C++ tests under the sanitizers"  # those of the kernels run every SIMD level
  $build/tests/cpp/fusionslam-tests
fi

echo "Python tests of the core under the sanitizers"
rm -rf $build/package
mkdir -p $build/package
cp -r python/fusionslam $build/package/
rm -f $build/package/fusionslam/_core*.so
cp $build/bindings/_core*.so $build/package/fusionslam/
run_pytest() {
  LD_PRELOAD="$(g++ -print-file-name=libasan.so) $(g++ -print-file-name=libubsan.so)" \
    PYTHONPATH=$build/package "$python" -m pytest -q -p no:cacheprovider --processor-limit 0 -n "$(nproc)" "$@"
}
run_pytest \
  tests/python/*/package/test_{array_layouts,refused_arrays,gil}.py \
  tests/python/*/descriptors/test_{descriptors,paper_m2dp,color_bins,m2dp_presets}.py \
  tests/python/*/fusion/test_{colorize,fuse,ground,rectify,stereo}.py \
  tests/python/*/views/test_{dbscan,hulls,scenes,scene_bytes,color_difference,scene_similarity}.py \
  tests/python/*/views/test_alignment.py
# KISS-Matcher of the wheels knows no sanitizer; what is ours of registration has own targets.
run_pytest tests/python/*/package/test_fuzz_targets.py -m nightly \
  -k "(functions or classes or scene or index) and not register"
