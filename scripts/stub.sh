#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
# Writes the type stub of the compiled module from the module itself; --check only compares.
set -euo pipefail
cd "$(dirname "$0")/.."
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
.venv/bin/pybind11-stubgen fusionslam._core -o "$folder" --exit-code >/dev/null
made=$folder/fusionslam/_core.pyi
sed -i -e '/^__version__/s/.*/__version__: str/' -e 's/os\.PathLike |/os.PathLike[str] |/' "$made"
# Members of enumerations as mypy wants them, without the methods of enum itself.
sed -i -E -e 's/^(    [A-Z_]+): typing\.ClassVar\[.*\]$/\1 = .../' -e '/^    @classmethod$/d' \
  -e '/def (__new__\(cls, value|__format__\(self, format_spec)\)/,+1d' "$made"
if [ "${1:-}" = --check ]; then
  diff -u python/fusionslam/_core.pyi "$made" ||
    { echo "python/fusionslam/_core.pyi is out of date: run make stub" >&2; exit 1; }
else
  cp "$made" python/fusionslam/_core.pyi
fi
