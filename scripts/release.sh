#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
# Builds sdist and wheel into out/dist, checks them, and installs the wheel into a fresh environment.
set -euo pipefail
cd "$(dirname "$0")/.."
bin=${VENV:-.venv}/bin

wanted=$("$bin/python" -c 'import tomllib; print(*tomllib.load(open("pyproject.toml", "rb"))["project"]["optional-dependencies"]["release"])')
# shellcheck disable=SC2086  # one requirement a word
"$bin/python" -m pip install --quiet --disable-pip-version-check $wanted

rm -rf out/dist build/release
"$bin/python" -m build --no-isolation --outdir out/dist >build/release.log 2>&1 ||
  { tail -50 build/release.log; exit 1; }
"$bin/python" -m twine check --strict out/dist/*
"$bin/python" -m venv build/release
build/release/bin/python -m pip install --quiet --disable-pip-version-check out/dist/*.whl
(cd build && release/bin/fusionslam doctor && release/bin/fusionslam --help >release-help.txt)
ls -l out/dist
