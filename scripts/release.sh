#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
# Builds a release into out/dist and tests every package in it: the wheels in a bare Debian, the sdist
# in one with the packages that docs/start/install.md names. Both systems are made in build/wheel,
# which needs root; for anybody else virtual environments serve. PYTHONS: as for wheel.sh.
set -euo pipefail
cd "$(dirname "$0")/.."
dist=out/dist work=$PWD/build/wheel failed=()
scripts/wheel.sh || failed+=("scripts/wheel.sh")
[ -e "$dist/SHA256SUMS" ] || exit 1

bare='' compiler=''
if [ "$(id -u)" = 0 ]; then
  scripts/debian.sh debootstrap
  # The oldest release that takes the wheels: they need the glibc that they were built with.
  release=$(sed -n 's/^VERSION_CODENAME=//p' /etc/os-release)
  bare=$work/$release compiler=$work/$release-compiler
  if [ ! -e "$bare.made" ]; then
    rm -rf "$bare"
    debootstrap --variant=minbase --include=ca-certificates,python3-venv "$release" "$bare" \
      >"$bare.log" || { tail "$bare.log"; exit 1; }
    # The package index may be reached by a certificate of one's own.
    cp /etc/ssl/certs/ca-certificates.crt "$bare/etc/ssl/certs/"
    touch "$bare.made"
  fi
  if [ ! -e "$compiler.made" ]; then
    rm -rf "$compiler"
    cp -a "$bare" "$compiler"
    read -ra packages < <(sed -nE 's/^apt-get install (g\+\+ [^#]*).*/\1/p' docs/start/install.md) ||
      { echo "docs/start/install.md names no packages to install" >&2; exit 1; }
    # Java, which libpcl-dev brings, cannot be installed without /proc.
    DEBIAN_FRONTEND=noninteractive unshare --pid --fork --mount-proc="$compiler/proc" \
      chroot "$compiler" sh -c 'apt-get update && apt-get install -y --no-install-recommends "$@"' \
      sh "${packages[@]}" >"$compiler.log" 2>&1 || { tail "$compiler.log"; exit 1; }
    touch "$compiler.made"
  fi
fi

summary=
for archive in "$dist"/*.whl "$dist"/*.tar.gz; do
  name=$(basename "$archive") root=$bare
  [[ $name == *.whl ]] || root=$compiler
  log=$work/test-$name.log
  echo "Testing $name"
  if scripts/test_wheel.sh "$archive" "$root" >"$log" 2>&1; then
    result="$(grep '^Python 3' "$log"), $(grep -E '^[0-9]+ passed' "$log")"
  else
    tail -30 "$log"
    result="FAILED, see $log" failed+=("$name")
  fi
  summary+="$name, $(du -h --apparent-size "$archive" | cut -f 1), $result"$'\n'
done
"$work/tools/bin/python" scripts/release_files.py "$dist" --check || failed+=("checksums")
echo "Tested in ${bare:-virtual environments}:"
echo "$summary$(wc -l <"$dist/SHA256SUMS") files in SHA256SUMS, $(grep -c '"bom-ref"' "$dist"/*.cdx.json) components in the SBOM"
[ "${#failed[@]}" = 0 ] || { echo "Failed: ${failed[*]}" >&2; exit 1; }
