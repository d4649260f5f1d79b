#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
# Installs a wheel away from the source and uses it: test_wheel.sh WHEEL [ROOT]. ROOT is a system
# for chroot with no more than that Python, its venv and certificates, as debootstrap makes; without
# it a fresh virtual environment serves. PYTHONS: where to look for the Python of the wheel. WITH:
# packages beside which it must compute the same, such as "torch opencv-python-headless".
set -euo pipefail
wheel=$(realpath "$1") root=${2:-}
cd "$(dirname "$0")/.."
version=$(sed -E 's/.*-cp3([0-9]+)-cp3.*/3.\1/' <<<"$wheel")
python=
for candidate in ${PYTHONS:-} "python$version"; do
  found=$(${root:+chroot "$root"} "$candidate" -c \
    'import sys; print("{}.{}".format(*sys.version_info[:2]))' 2>&1) || continue
  [ "$found" != "$version" ] || { python=$(type -P "$candidate" || echo "$candidate"); break; }
done
if [ -z "$python" ]; then
  echo "no Python $version to test $(basename "$wheel") with" >&2
  exit 1
fi
[ -z "$root" ] || python=python$version

# The tests without the package that they would find beside them.
folder=${root:-$PWD/build/wheel}/test-$version
rm -rf "$folder"
mkdir -p "$folder"
git ls-files -z pyproject.toml benchmarks tests/python tests/data | tar -c --null -T - | tar -x -C "$folder"
cp "$wheel" "$folder"
cat >"$folder/test.sh" <<'END'
set -euo pipefail
cd "$(dirname "$0")"
"$1" -m venv environment
bin=$PWD/environment/bin
# shellcheck disable=SC2086  # one package a word
"$bin/python" -m pip install --quiet --disable-pip-version-check \
  "$(echo "$PWD"/*.whl)[sim,bags,report]" pytest hypothesis scikit-learn ${WITH:-}
mkdir elsewhere
(
  cd elsewhere
  "$bin/fusionslam" doctor
  "$bin/fusionslam" demo --set sim.drive.spacing_m=10 -o demo
)
"$bin/python" -c '
from importlib.util import find_spec
from fusionslam import _core
assert "environment" in _core.__file__, _core.__file__
assert find_spec("fusionslam_ros.msg"), "no messages of ROS"'
"$bin/python" -m pytest -q -p no:cacheprovider tests/python/descriptors tests/python/fusion \
  tests/python/matching tests/python/package/test_other_libraries.py
END
mapfile -t kept < <(env | grep -E '^(PIP_|SSL_CERT_|WITH=|OMP_NUM_THREADS=|OPENBLAS_NUM_THREADS=)')
${root:+chroot "$root"} env -i HOME="${folder#"$root"}" LANG=C.UTF-8 \
  PATH=/usr/local/bin:/usr/bin:/bin FUSIONSLAM_TEST_DATA=/nonexistent "${kept[@]}" \
  bash "${folder#"$root"}/test.sh" "$python"
echo "$(basename "$wheel") works${root:+ in $root}"
