#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
# Builds into out/dist: the sdist, from it one wheel for each Python, which holds all but the C and
# C++ runtime, an SBOM, and checksums. PYTHONS="python3.11 /opt/python3.14/bin/python3" says for
# which; without it, for those of 3.11 to 3.14 that are on PATH and run. A Python whose wheel fails
# is named at the end, after the wheels of the others are built.
set -euo pipefail
cd "$(dirname "$0")/.."
bin=$PWD/${VENV:-.venv}/bin work=$PWD/build/wheel dist=$PWD/out/dist
tools=$work/tools/bin
scripts/debian.sh dpkg-dev libpcl-dev libopencv-dev libeigen3-dev libqhull-dev \
  python3-genpy ros-std-msgs ros-geometry-msgs  # which make the messages of the ROS nodes
# Each Python would name the compiler that it was built with, which compiles the core once more.
export CC=${CC:-gcc} CXX=${CXX:-g++}
! command -v ccache >/dev/null || export CMAKE_C_COMPILER_LAUNCHER=ccache CMAKE_CXX_COMPILER_LAUNCHER=ccache

rm -rf "$dist" "$work"/{raw,repaired,source}
mkdir -p "$work/source"
[ -x "$tools/python" ] || "$bin/python" -m venv "$work/tools"
mapfile -t wanted < <("$bin/python" -c 'import tomllib
for wanted in tomllib.load(open("pyproject.toml", "rb"))["project"]["optional-dependencies"]["release"]: print(wanted)')
# The wheels are built by what .venv is built by.
mapfile -t builders < <("$bin/python" -m pip list --format freeze | grep -E '^(scikit[-_]build[-_]core|pybind11|hatch-fancy-pypi-readme)==')
install() { "$tools/python" -m pip --disable-pip-version-check "$@"; }
install install --quiet "${wanted[@]}" "${builders[@]}"

"$tools/python" -m build --sdist --no-isolation --outdir "$dist" >"$work/sdist.log" 2>&1 ||
  { tail -50 "$work/sdist.log"; exit 1; }
tar -xzf "$dist"/*.tar.gz --strip-components 1 -C "$work/source"
opencv=$(scripts/opencv.sh)

# Prints the version of a Python for which a wheel can be built, or else says why not and fails.
version_of() {
  "$1" -c '
import sys, sysconfig
from pathlib import Path
version = "{}.{}".format(*sys.version_info[:2])
if not (3, 11) <= sys.version_info[:2]:
    sys.exit(f"fusionslam needs Python 3.11 or newer, this is {version}")
if not (Path(sysconfig.get_path("include")) / "Python.h").is_file():
    sys.exit("no Python.h: its development package is missing")
print(version)' 2>"$work/refusal" && return
  echo "skipped $1: $(head -1 "$work/refusal")" >&2
  return 1
}

# Builds the wheel for a Python. No path of this machine gets in, which assertions would name.
build_wheel() {
  local python=$1 version=$2 environment=$work/venv-$2 raw=$work/raw/$2 repaired=$work/repaired/$2
  rm -rf "$environment"
  "$python" -m venv --without-pip "$environment" &&
    install --python "$environment/bin/python" install --quiet "${builders[@]}" ninja &&
    # In one build folder, so that the core is compiled once for all.
    install --python "$environment/bin/python" wheel --no-build-isolation --no-deps \
      -C "build-dir=$work/source/build/cmake" -C "cmake.define.OpenCV_DIR=$opencv" \
      -C "cmake.define.CMAKE_CXX_FLAGS=-ffile-prefix-map=$PWD/= -ffile-prefix-map=/usr/include/=" \
      -w "$raw" "$work/source" &&
    PATH=$tools:$PATH "$tools/auditwheel" repair --strip -w "$repaired" "$raw"/*.whl &&
    "$tools/python" scripts/wheel_contents.py "$repaired"/*.whl "$dist"
}

built=() failed=()
for python in ${PYTHONS:-python3.11 python3.12 python3.13 python3.14}; do
  if ! version=$(version_of "$python"); then
    [ -z "${PYTHONS:-}" ] || failed+=("$python")
    continue
  fi
  echo "Building the wheel for Python $version"
  if build_wheel "$python" "$version" >"$work/build-$version.log" 2>&1; then
    built+=("$version")
  else
    tail -50 "$work/build-$version.log"
    failed+=("$python")
  fi
done
[ "${#built[@]}" -gt 0 ] || { echo "no wheel was built" >&2; exit 1; }

# The SBOM beside the wheels names the packages that pip installs with them, and those inside name
# the libraries that each contains.
environment=$work/venv-sbom
rm -rf "$environment"
"$work/venv-${built[0]}/bin/python" -m venv --without-pip "$environment"
install --python "$environment/bin/python" install --quiet "$dist"/*-cp"${built[0]/./}"-*.whl
"$tools/cyclonedx-py" environment "$environment/bin/python" --output-reproducible --of JSON \
  -o "$dist/$(basename "$dist"/*.tar.gz .tar.gz).cdx.json"
"$tools/python" -m twine check --strict "$dist"/*.whl "$dist"/*.tar.gz
"$tools/python" scripts/release_files.py "$dist"
echo "Built for Python ${built[*]}:"
ls -l "$dist"
[ "${#failed[@]}" = 0 ] || { echo "No wheel for: ${failed[*]}" >&2; exit 1; }
