#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
# Builds the three modules of OpenCV that the core uses, from Debian's source and static, and prints
# the folder with their CMake files. Debian's own libraries bring LAPACK, TBB, OpenGL and X11, which
# a wheel would have to contain, or to demand of every system.
set -euo pipefail
cd "$(dirname "$0")/.."
version=$(dpkg-query -W -f '${source:Version}' libopencv-dev)
work=$PWD/build/wheel/opencv-$version
found=$work/install/lib/cmake/opencv4
# One that an older version of this script built may hold what is kept out now.
if [ "$work/built" -nt scripts/opencv.sh ]; then echo "$found"; exit; fi

# The sources of this system's own packages: each list once more, with deb-src for deb. What one of
# them lacks is of no matter as long as another has OpenCV.
mkdir -p "$work/apt/lists/partial"
for list in /etc/apt/sources.list /etc/apt/sources.list.d/*; do
  [ ! -e "$list" ] || sed -E 's/^(Types:.*)\bdeb\b/\1deb-src/; s/^deb\b/deb-src/' "$list" |
    sed 's/deb-src-src/deb-src/' >"$work/apt/$(basename "$list")"
done
options=(-qq -o Dir::Etc::SourceList=/dev/null -o "Dir::Etc::SourceParts=$work/apt"
  -o "Dir::State::Lists=$work/apt/lists" -o "Dir::Cache=$work/apt" -o APT::Sandbox::User=)
apt-get "${options[@]}" update >&2 || true
rm -rf "$work/source"
mkdir "$work/source"
(cd "$work/source" && apt-get "${options[@]}" source "opencv=$version" >"$work/source.log" 2>&1) ||
  { tail -5 "$work/source.log" >&2; exit 1; }

# What is found on the machine must not get in, nor its paths, which assertions would name.
flags="-ffile-prefix-map=$work/="
without=(1394 ADE CAROTENE CUDA EIGEN FFMPEG GSTREAMER GTK IPP ITT JASPER JPEG LAPACK OPENCL OPENEXR
  OPENGL OPENJPEG OPENMP PNG PROTOBUF QUIRC TBB TIFF V4L VTK WEBP)
without=("${without[@]/#/-DWITH_}")
cmake -S "$work"/source/opencv-*/ -B "$work/build" -G Ninja -D CMAKE_BUILD_TYPE=Release \
  -D CMAKE_INSTALL_PREFIX="$work/install" -D CMAKE_POSITION_INDEPENDENT_CODE=ON \
  -D BUILD_LIST=core,imgproc,calib3d -D BUILD_SHARED_LIBS=OFF -D BUILD_TESTS=OFF \
  -D BUILD_PERF_TESTS=OFF -D BUILD_opencv_apps=OFF -D BUILD_JAVA=OFF -D BUILD_ZLIB=OFF \
  -D ENABLE_PRECOMPILED_HEADERS=OFF -D OPENCV_DOWNLOAD_TRIES_LIST= "${without[@]/%/=OFF}" \
  -D CMAKE_C_FLAGS="$flags" -D CMAKE_CXX_FLAGS="$flags" \
  >"$work/configure.log" 2>&1 || { tail -30 "$work/configure.log" >&2; exit 1; }
# What getBuildInformation() tells, and where OpenCV looks for data.
echo '""' >"$work/build/modules/core/version_string.inc"
echo >"$work/build/opencv_data_config.hpp"
cmake --build "$work/build" --target install >"$work/build.log" 2>&1 ||
  { tail -30 "$work/build.log" >&2; exit 1; }
touch "$work/built"
echo "$found"
