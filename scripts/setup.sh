#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
# Installs the Debian packages, makes .venv and installs fusionslam into it with what demo and
# tests need. Does only what is still to be done, so it can be run at any time.
set -euo pipefail
cd "$(dirname "$0")/.."

packages=(
  ca-certificates g++ cmake ninja-build git
  python3 python3-dev python3-venv
  libpcl-dev libopencv-dev libeigen3-dev libqhull-dev doctest-dev
)

missing=()
for package in "${packages[@]}"; do
  [ "$(dpkg-query -W -f '${db:Status-Status}' "$package" 2>/dev/null)" = installed ] ||
    missing+=("$package")
done
if [ "${#missing[@]}" -gt 0 ]; then
  if [ "$(id -u)" = 0 ]; then
    as_root=(env)
  elif command -v sudo >/dev/null && sudo -v; then
    as_root=(sudo env)
  else
    echo "fusionslam needs these Debian packages; have them installed and run this again:" >&2
    echo "  apt-get install --no-install-recommends ${missing[*]}" >&2
    exit 1
  fi
  echo "Installing Debian packages: ${missing[*]}"
  "${as_root[@]}" apt-get update -qq
  "${as_root[@]}" DEBIAN_FRONTEND=noninteractive \
    apt-get install -y -qq --no-install-recommends "${missing[@]}" >/dev/null
fi

if [ ! -x .venv/bin/python ]; then
  python3 -c 'import sys; sys.exit(sys.version_info < (3, 11))' ||
    { echo "fusionslam needs Python 3.11 or newer, found $(python3 --version)" >&2; exit 1; }
  python3 -m venv .venv
fi

stamp=.venv/.fusionslam-installed
if [ ! -e "$stamp" ] || [ pyproject.toml -nt "$stamp" ]; then
  echo "Installing Python packages into .venv"
  # Build tools stay in .venv, so that a second build compiles only what changed.
  .venv/bin/python -m pip install --quiet --disable-pip-version-check \
    "scikit-build-core==1.1.2" "pybind11==3.1.0" "torch==2.13.0"
  extras=".[all,dev]"
  rm -f "$stamp"
fi
if [ ! -e "$stamp" ] ||
  [ -n "$(find CMakeLists.txt README.md LICENSE cpp bindings python ros -newer "$stamp" -type f \
    -not -name '*.pyc' -print -quit)" ]; then
  echo "Building fusionslam"
  touch "$stamp.new"  # what is edited during the build is built again next time
  .venv/bin/python -m pip install --quiet --disable-pip-version-check --no-build-isolation \
    "${extras:-.}"
  mv "$stamp.new" "$stamp"
fi
