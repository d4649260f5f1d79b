#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
# Installs a wheel or an sdist away from the source and uses it: test_wheel.sh ARCHIVE [ROOT]. ROOT is
# a system for chroot, as debootstrap makes, with no more than a Python, its venv and certificates,
# and for an sdist the packages that docs/start/install.md names; without it a fresh virtual
# environment serves. PYTHONS: where to look for the Python of a wheel; one that ROOT lacks is copied
# into it. WITH: packages beside which it must compute the same, such as "torch opencv-python-headless".
set -euo pipefail
archive=$(realpath "$1") root=${2:-}
cd "$(dirname "$0")/.."
print_version='import sys; print("{}.{}".format(*sys.version_info[:2]))'
version=$(sed -nE 's/.*-cp3([0-9]+)-cp3.*/3.\1/p' <<<"$archive")
[ -n "$version" ] || version=$(${root:+chroot "$root"} python3 -c "$print_version")

is_wanted() { [ "$("$@" -c "$print_version" 2>/dev/null)" = "$version" ]; }
python=
for candidate in ${root:+"python$version"} ${PYTHONS:-} "python$version"; do
  if is_wanted ${root:+chroot "$root"} "$candidate"; then
    python=$candidate
    break
  elif [ -n "$root" ] && is_wanted "$candidate"; then
    prefix=$("$candidate" -c 'import sys; print(sys.base_prefix)')
    [ "$prefix" != /usr ] || continue
    mkdir -p "$root$prefix"
    tar -C "$prefix" -c --exclude=site-packages --exclude=test . | tar -C "$root$prefix" -x
    python=$prefix/bin/python$version
    break
  fi
done
if [ -z "$python" ]; then
  echo "no Python $version to test $(basename "$archive") with" >&2
  exit 1
fi
[ -n "$root" ] || python=$(type -P "$python")

# The tests without the package that they would find beside them.
folder=${root:-$PWD/build/wheel}/test-$version
rm -rf "$folder"
mkdir -p "$folder"
git ls-files -z pyproject.toml benchmarks docs/stages/descriptors.md tests/python tests/data | tar -c --null -T - | tar -x -C "$folder"
cp "$archive" "$folder"
cat >"$folder/test.sh" <<'END'
set -euo pipefail
cd "$(dirname "$0")"
"$1" --version
"$1" -m venv environment
bin=$PWD/environment/bin
# shellcheck disable=SC2086  # one package a word
"$bin/python" -m pip install --quiet --disable-pip-version-check \
  "$PWD/$2[sim,bags,report]" pytest filelock hypothesis scikit-learn ${WITH:-}
mkdir elsewhere
(
  cd elsewhere
  "$bin/fusionslam" doctor
  "$bin/fusionslam" demo --set sim.drive.spacing_m=10 -o demo
)
"$bin/python" -c '
from importlib.util import find_spec
from sys import argv
from fusionslam import _core
assert "environment" in _core.__file__, _core.__file__
assert find_spec("fusionslam_ros.msg") or not argv[1].endswith(".whl"), "no messages of ROS"' "$2"
"$bin/python" -m pytest -q -p no:cacheprovider tests/python/*/descriptors tests/python/*/fusion \
  tests/python/*/matching tests/python/system/package/test_other_libraries.py
END
mapfile -t kept < <(
  env | grep -E '^(PIP_|SSL_CERT_|(WITH|CMAKE_BUILD_PARALLEL_LEVEL|OMP_NUM_THREADS|OPENBLAS_NUM_THREADS)=)')
${root:+chroot "$root"} env -i HOME="${folder#"$root"}" LANG=C.UTF-8 \
  PATH=/usr/local/bin:/usr/bin:/bin FUSIONSLAM_TEST_DATA=/nonexistent "${kept[@]}" \
  bash "${folder#"$root"}/test.sh" "$python" "$(basename "$archive")"
echo "$(basename "$archive") works${root:+ in $root}"
