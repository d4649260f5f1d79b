#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
# Installs the Debian packages, makes .venv (VENV) with Python (PYTHON) and installs fusionslam into
# it with what the tests need, or with what the demo needs only: setup.sh demo. Does only what is
# still to be done, so it can be run at any time.
set -euo pipefail
cd "$(dirname "$0")/.."

wanted=${1:-tests}
packages=(
  ca-certificates g++ cmake ninja-build ccache git
  python3 python3-dev python3-venv
  libpcl-dev libopencv-dev libeigen3-dev libqhull-dev
)
[ "$wanted" = demo ] || packages+=(doctest-dev haproxy)

scripts/debian.sh "${packages[@]}"

source scripts/ccache.sh
python=${PYTHON:-python3} venv=${VENV:-.venv}
if [ ! -x "$venv/bin/python" ]; then
  "$python" -c 'import sys; sys.exit(sys.version_info < (3, 11))' ||
    { echo "fusionslam needs Python 3.11 or newer, found $("$python" --version)" >&2; exit 1; }
  "$python" -m venv "$venv"
fi

# Whether ROS came after the last build, which now can make the messages of the nodes.
lacks_messages() {
  [ -e /usr/lib/genpy/genmsg_py.py ] && [ -d /usr/share/std_msgs/msg ] &&
    [ -d /usr/share/geometry_msgs/msg ] &&
    [ ! -d "$("$venv/bin/python" -c 'import sysconfig; print(sysconfig.get_path("purelib"))')/fusionslam_ros" ]
}

stamp=$venv/.fusionslam-installed  # says for what
installed=$(cat "$stamp" 2>/dev/null || true)
[ "$installed" != tests ] || wanted=tests  # what is there stays
pip=("$venv/bin/python" -m pip install --disable-pip-version-check)
[ -t 1 ] || pip+=(--quiet)  # nobody sees how far downloads are
if [ "$installed" != "$wanted" ] || [ pyproject.toml -nt "$stamp" ]; then
  # Build tools stay there, so that a second build compiles only what changed.
  tools=("scikit-build-core==1.1.2" "pybind11==3.1.0" "hatch-fancy-pypi-readme==25.1.0"
    "numpy>=2.0" "pybind11-stubgen==3.0.0")
  if [ "$wanted" = demo ]; then
    extras=".[sim,report,map]"
    echo "Installing Python packages into $venv: 140 MB of downloads"
  else
    tools+=("torch==2.13.0")
    extras=".[all,fleet,dev,docs]"
    echo "Installing Python packages into $venv: 0.9 GB of downloads, all extras"
  fi
  "${pip[@]}" "${tools[@]}"
  rm -f "$stamp"
fi
if [ ! -e "$stamp" ] || lacks_messages ||
  [ -n "$(find CMakeLists.txt README.md LICENSE cpp bindings python ros -newer "$stamp" -type f \
    -not -name '*.pyc' -print -quit)" ]; then
  echo "Building fusionslam"
  echo "$wanted" >"$stamp.new"  # what is edited during the build is built again next time
  "${pip[@]}" --no-build-isolation "${extras:-.}"
  mv "$stamp.new" "$stamp"
fi
# For type checkers, which look for it beside the sources.
stub=$("$venv/bin/python" -c 'import sysconfig; print(sysconfig.get_path("purelib"))')/fusionslam/_core.pyi
ln -sf "$stub" python/fusionslam/_core.pyi
