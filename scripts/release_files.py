# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Writes the checksums of a release: in SHA256SUMS of all files, in its SBOM of the packages.

release_files.py FOLDER writes them; with --check, it ends with an error if they are not exactly
those of the files in FOLDER, which are the wheels, the sdist, the SBOM and SHA256SUMS.
"""

import hashlib
import json
import sys
from pathlib import Path
from typing import Any


def sha256(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def find_files(folder: Path) -> tuple[list[Path], Path]:
    """Return the packages and the SBOM in `folder`, which may have no other files."""
    files = sorted(path for path in folder.iterdir() if path.name != "SHA256SUMS")
    packages = [path for path in files if path.name.endswith((".whl", ".tar.gz"))]
    sboms = [path for path in files if path.name.endswith(".cdx.json")]
    if not packages or len(sboms) != 1 or len(files) != len(packages) + 1:
        sys.exit(f"{folder}: expected packages and one SBOM, found {[file.name for file in files]}")
    return packages, sboms[0]


def distributions(packages: list[Path]) -> list[dict[str, Any]]:
    """Return what the SBOM says of the packages (CycloneDX: external references)."""
    return [
        {
            "type": "distribution",
            "url": path.name,
            "hashes": [{"alg": "SHA-256", "content": sha256(path)}],
        }
        for path in packages
    ]


def own_component(sbom: dict[str, Any]) -> dict[str, Any]:
    return next(part for part in sbom["components"] if part["name"] == "fusionslam")


def checksums(files: list[Path]) -> str:
    return "".join(f"{sha256(path)}  {path.name}\n" for path in sorted(files))


def write(folder: Path) -> None:
    packages, path = find_files(folder)
    sbom = json.loads(path.read_text(encoding="utf-8"))
    own_component(sbom)["externalReferences"] = distributions(packages)
    path.write_text(json.dumps(sbom, indent=1) + "\n", encoding="utf-8")
    (folder / "SHA256SUMS").write_text(checksums([*packages, path]), encoding="utf-8")


def check(folder: Path) -> None:
    packages, path = find_files(folder)
    sbom = json.loads(path.read_text(encoding="utf-8"))
    if own_component(sbom).get("externalReferences") != distributions(packages):
        sys.exit(f"{path}: its checksums are not those of the packages beside it")
    if (folder / "SHA256SUMS").read_text(encoding="utf-8") != checksums([*packages, path]):
        sys.exit(f"{folder / 'SHA256SUMS'}: not the checksums of the files beside it")


if __name__ == "__main__":
    match sys.argv[1:]:
        case [folder]:
            write(Path(folder))
        case [folder, "--check"]:
            check(Path(folder))
        case _:
            sys.exit(__doc__)
