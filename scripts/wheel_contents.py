# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Adds to a repaired wheel the licences of what it contains, and completes its SBOM.

wheel_contents.py WHEEL FOLDER writes the wheel into FOLDER. auditwheel lists the shared libraries
that it has put in; what is compiled into the extension module is listed here. A library that
LICENSES does not name ends the program: somebody has to read its licence first. So does a file
that names a folder of the machine.
"""

import json
import re
import subprocess
import sys
import tempfile
from importlib import metadata
from pathlib import Path
from typing import Any
from urllib.parse import unquote

LICENSES = {
    r"libboost[\d.]+-dev": "BSL-1.0",
    r"libeigen3-dev": "MPL-2.0",
    r"libgomp1": "GPL-3.0-or-later WITH GCC-exception-3.1",
    r"libopencv-core-dev": "Apache-2.0",
    r"libpcl-common[\d.]+": "BSD-3-Clause",
    r"libqhull-r[\d.]+": "Qhull",
    r"pybind11": "BSD-3-Clause",
}
COMPILED_IN = {  # one header of each library
    "boost": "/usr/include/boost/version.hpp",
    "eigen": "/usr/include/eigen3/Eigen/Core",
    "opencv": "/usr/include/opencv4/opencv2/core.hpp",
}


def run(*command: str | Path) -> str:
    return subprocess.run(
        [str(word) for word in command], check=True, capture_output=True, text=True
    ).stdout


def license_of(package: str) -> str:
    for pattern, license in LICENSES.items():
        if re.fullmatch(pattern, package):
            return license
    sys.exit(f"{package}: not among LICENSES of {Path(__file__).name}; read its licence first")


def compiled_in_components() -> list[dict[str, Any]]:
    owners = [run("dpkg", "-S", header).partition(":")[0] for header in COMPILED_IN.values()]
    versions = [run("dpkg-query", "-W", "-f", "${Version}", owner) for owner in owners]
    found = [
        ("deb/debian", name, version) for name, version in zip(owners, versions, strict=True)
    ] + [("pypi", "pybind11", metadata.version("pybind11"))]
    return [
        {"type": "library", "name": name, "version": version, "bom-ref": purl, "purl": purl}
        for kind, name, version in found
        if (purl := f"pkg:{kind}/{name}@{version.replace('+', '%2B')}")
    ]


def text_of_license(component: dict[str, Any]) -> str:
    if component["purl"].startswith("pkg:deb/"):
        return Path("/usr/share/doc", component["name"], "copyright").read_text(encoding="utf-8")
    files = metadata.files(component["name"]) or []
    return next(file for file in files if file.name == "LICENSE").read_text(encoding="utf-8")


def complete_sbom(path: Path) -> list[dict[str, Any]]:
    """Add what is compiled in, and all licences; returns the components of others."""
    sbom = json.loads(path.read_text(encoding="utf-8"))
    own = sbom["metadata"]["component"]["bom-ref"]
    compiled_in = compiled_in_components()
    sbom["components"] += compiled_in
    for entry in sbom["dependencies"]:
        if entry["ref"] == own:
            entry["dependsOn"] += [component["bom-ref"] for component in compiled_in]
    sbom["dependencies"] += [{"ref": component["bom-ref"]} for component in compiled_in]
    others = [component for component in sbom["components"] if component["bom-ref"] != own]
    for component in others:
        component["licenses"] = [{"expression": license_of(component["name"])}]
    path.write_text(json.dumps(sbom, indent=1) + "\n", encoding="utf-8")
    return others


def add_licenses(dist_info: Path, components: list[dict[str, Any]]) -> None:
    folder = dist_info / "licenses" / "bundled"
    folder.mkdir()
    names = []
    for component in components:
        if license_of(component["name"]) == "BSL-1.0":
            continue  # which asks for its text with sources only
        names.append(f"bundled/{unquote(component['name'])}.txt")
        (folder.parent / names[-1]).write_text(text_of_license(component), encoding="utf-8")
    description = dist_info / "METADATA"
    head, blank, body = description.read_text(encoding="utf-8").partition("\n\n")
    head += "".join(f"\nLicense-File: {name}" for name in names)
    description.write_text(head + blank + body, encoding="utf-8")


def refuse_paths(unpacked: Path) -> None:
    """End the program if a file in the wheel names a folder or a source file of this machine.

    Debian's libraries name those in /usr/include, which are the same everywhere.
    """
    source = re.escape(bytes(Path(__file__).resolve().parents[1]))
    named = re.compile(
        rb"(?<![\w.+:/-])(?:"
        rb"(?:%b|/home|/root)/[\w.+/-]+"
        rb"|(?!/usr/include/)/[\w.+/-]+\.(?:c|cc|cpp|cxx|h|hh|hpp|hxx|inc|inl)\b)" % source
    )
    found = [
        f"{path.relative_to(unpacked)}: {match[0].decode()}"
        for path in sorted(unpacked.rglob("*"))
        if path.is_file() and (match := named.search(path.read_bytes()))
    ]
    if found:
        sys.exit("\n".join(["paths of the machine that built the wheel:", *found]))


def main() -> None:
    wheel, output = sys.argv[1:]
    with tempfile.TemporaryDirectory() as folder:
        run(sys.executable, "-m", "wheel", "unpack", wheel, "-d", folder)
        (unpacked,) = Path(folder).iterdir()
        (dist_info,) = unpacked.glob("*.dist-info")
        add_licenses(dist_info, complete_sbom(dist_info / "sboms" / "auditwheel.cdx.json"))
        refuse_paths(unpacked)
        run(sys.executable, "-m", "wheel", "pack", unpacked, "-d", output)


if __name__ == "__main__":
    main()
