#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
# Installs those of the given Debian packages that are not there yet, or says how to.
set -euo pipefail

missing=()
for package in "$@"; do
  [ "$(dpkg-query -W -f '${db:Status-Status}' "$package" 2>/dev/null)" = installed ] ||
    missing+=("$package")
done
[ "${#missing[@]}" -gt 0 ] || exit 0
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
install=("${as_root[@]}" DEBIAN_FRONTEND=noninteractive LC_ALL=C
  apt-get install -y --no-install-recommends "${missing[@]}")
if [ -t 1 ]; then
  "${install[@]}" -o Dpkg::Progress-Fancy=1
else
  "${install[@]}" -q | { grep -E '^(Need to get|After this operation)' || true; }
fi
