# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What wheels and releases may contain, as scripts/ checks it."""

import importlib.util
import json
import re
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

from project import PROJECT
from rows import rows


def load_script(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, PROJECT / "scripts" / f"{name}.py")
    assert spec and spec.loader
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@rows(
    "planted",
    [
        f"{PROJECT}/build/wheel/opencv/modules/core/src/matrix",
        "/home/someone/project/file",
        "/root/.pyenv/versions/3.12.1/include/python3.12",
        "/tmp/pip-build-env/overlay/pybind11.h",
        "/srv/sources/bindings/module.cpp",
    ],
)
def test_a_wheel_that_names_a_path_of_its_machine_is_refused(tmp_path: Path, planted: str) -> None:
    core = tmp_path / "fusionslam" / "_core.so"
    core.parent.mkdir()
    harmless = b"\0cpp/src/scene.cpp\0/proc/cpuinfo\0/tmp/a.XXXXXX\0/usr/include/memory.h\0https://example.org/a.h\0"
    refuse_paths = load_script("wheel_contents").refuse_paths
    core.write_bytes(harmless)
    refuse_paths(tmp_path)
    core.write_bytes(harmless + planted.encode() + b"\0")
    with pytest.raises(SystemExit, match=f"_core.so: {re.escape(planted)}"):
        refuse_paths(tmp_path)


@pytest.fixture
def release(tmp_path: Path) -> Path:
    for name in ["fusionslam-1.whl", "fusionslam-2.whl", "fusionslam.tar.gz"]:
        (tmp_path / name).write_text(name)
    sbom = {"components": [{"name": "numpy"}, {"name": "fusionslam", "externalReferences": []}]}
    (tmp_path / "fusionslam.cdx.json").write_text(json.dumps(sbom))
    load_script("release_files").write(tmp_path)
    return tmp_path


def test_checksums_and_sbom_name_every_file_of_a_release(release: Path) -> None:
    subprocess.run(["sha256sum", "--check", "--strict", "SHA256SUMS"], cwd=release, check=True)
    listed = {line.split()[1] for line in (release / "SHA256SUMS").read_text().splitlines()}
    assert listed == {path.name for path in release.iterdir()} - {"SHA256SUMS"}
    sbom = json.loads((release / "fusionslam.cdx.json").read_text())
    assert [part["url"] for part in sbom["components"][1]["externalReferences"]] == [
        "fusionslam-1.whl",
        "fusionslam-2.whl",
        "fusionslam.tar.gz",
    ]
    load_script("release_files").check(release)


@rows("name", ["fusionslam-1.whl", "fusionslam.cdx.json", "fusionslam-3.whl"])
def test_a_file_that_changes_or_comes_after_the_checksums_is_found(
    release: Path, name: str
) -> None:
    with (release / name).open("a") as file:
        file.write("\n")
    with pytest.raises(SystemExit):
        load_script("release_files").check(release)


def test_a_file_that_goes_after_the_checksums_is_found(release: Path) -> None:
    (release / "fusionslam-1.whl").unlink()
    with pytest.raises(SystemExit):
        load_script("release_files").check(release)


def test_an_sbom_that_lacks_a_package_is_found(release: Path) -> None:
    script = load_script("release_files")
    path = release / "fusionslam.cdx.json"
    sbom = json.loads(path.read_text())
    del sbom["components"][1]["externalReferences"][0]
    path.write_text(json.dumps(sbom))
    packages, _ = script.find_files(release)
    (release / "SHA256SUMS").write_text(script.checksums([*packages, path]))
    with pytest.raises(SystemExit, match=path.name):
        script.check(release)


def test_the_description_of_a_package_has_no_links_to_files_that_it_lacks() -> None:
    text = subprocess.run(
        [sys.executable, "-m", "hatch_fancy_pypi_readme"],
        cwd=PROJECT,
        check=True,
        capture_output=True,
        text=True,
    ).stdout
    targets = re.findall(r"\]\(([^)]*)\)", text)
    assert [target for target in targets if not target.startswith("https:")] == []
    assert "read |\n" in text and "](docs/" in (PROJECT / "README.md").read_text()
    assert "pip install" in text and "<!--" not in text
