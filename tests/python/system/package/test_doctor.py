# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The checks of ``fusionslam doctor``."""

import ast
import inspect
import os
import re
import runpy
import shutil
import subprocess
import sys
import textwrap
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import pytest
from typer.main import get_command

import fusionslam
from expected_output import commands_of
from fusionslam import ConfigError, _core
from fusionslam.cli import app
from fusionslam.doctor import EXTRAS, Finding, examine
from fusionslam.errors import FusionSlamError
from fusionslam.ros.ros1 import environment
from rows import rows

PACKAGE = Path(fusionslam.__file__).parent


def problems(findings: list[Finding]) -> dict[str, tuple[str, list[str], bool]]:
    return {f.what: (f.code, list(f.fields), f.optional) for f in findings if not f.fine}


def test_a_whole_installation_has_no_problem_and_names_versions() -> None:
    findings = examine()
    assert not problems(findings)
    text = " ".join(finding.detail for finding in findings)
    for name in ("embreex", "pycollada", "rosbags", "matplotlib", "torch", "pymoo", "rerun-sdk"):
        assert f"{name} {version(name)}" in text


def test_a_missing_extra_is_optional_and_a_missing_package_is_not(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def installed(name: str) -> str:
        if name == "scipy":
            raise PackageNotFoundError(name)
        return "1.0"

    monkeypatch.setattr("fusionslam.doctor.metadata.version", installed)
    assert problems(examine(["bags"])) == {
        "scipy": ("no-package", ["scipy"], False),
        "extra bags": ("no-extra", ["bags"], True),
    }


@rows(
    "python, extra, package, has_package",
    [
        ((3, 12), "map", "kiss-matcher", True),
        ((3, 13), "map", "kiss-matcher", False),
        ((3, 13), "map", "gtsam", True),
        ((3, 13), "odometry", "kiss-icp", True),
        ((3, 14), "odometry", "kiss-icp", False),
    ],
)
def test_a_package_that_python_does_not_get_is_no_part_of_its_extra(
    python: tuple[int, int],
    extra: str,
    package: str,
    has_package: bool,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(sys, "version_info", python)
    modules = runpy.run_path(str(PACKAGE / "doctor.py"))["EXTRAS"][extra].modules
    assert (package in modules) == has_package


def test_a_cache_that_cannot_be_written_is_a_fault(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FUSIONSLAM_CACHE", "/proc/nowhere")
    assert problems(examine()) == {"cache": ("cache-not-writable", [], False)}


def test_an_unknown_level_of_instructions_is_a_fault(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse() -> str:
        raise ConfigError("FUSIONSLAM_SIMD is 'abacus'")

    monkeypatch.setattr("fusionslam.simd_level", refuse)
    assert problems(examine()) == {"instructions": ("unknown-simd-level", [], False)}


def test_ros_is_optional_and_its_messages_are_checked(monkeypatch: pytest.MonkeyPatch) -> None:
    for code in ("no-ros", "no-ros-messages"):

        def refuse(code: str = code) -> None:
            raise FusionSlamError("this needs ROS", code=code)

        monkeypatch.setattr(environment, "find_ros", refuse)
        assert problems([environment.check_ros()]) == {"ros": (code, [], True)}


@pytest.fixture
def without_library(tmp_path: Path) -> dict[str, str]:
    """The environment of a package whose core needs a library that does not exist."""
    core = Path(_core.__file__)
    library = re.search(rb"\0(libqhull_r[-\w.]*\.so[\w.]*)\0", core.read_bytes())
    if library is None or shutil.which("ldd") is None:
        pytest.skip("needs ldd and a core that is linked with Qhull")
    package = tmp_path / "fusionslam"
    package.mkdir()
    for path in PACKAGE.iterdir():
        if path != core:
            (package / path.name).symlink_to(path)
    renamed = library[1].replace(b"libqhull", b"libq_ull")
    (package / core.name).write_bytes(core.read_bytes().replace(library[1], renamed))
    return os.environ | {"PYTHONPATH": str(tmp_path), "COLUMNS": "400"}


def run_python(environment: dict[str, str], *words: str) -> "subprocess.CompletedProcess[str]":
    command = [sys.executable, *words]
    return subprocess.run(command, env=environment, capture_output=True, text=True, check=False)


def test_without_a_library_of_the_core_doctor_names_it_and_its_package(
    without_library: dict[str, str], tmp_path: Path
) -> None:
    # As if two libraries needed it.
    listing = tmp_path / "ldd"
    listing.write_text(f'#!/bin/sh\n{shutil.which("ldd")} "$@"; {shutil.which("ldd")} "$@"\n')
    listing.chmod(0o755)
    path = f"{tmp_path}:{os.environ['PATH']}"
    result = run_python(without_library | {"PATH": path}, "-m", "fusionslam", "doctor")
    assert result.returncode == 1 and result.stderr == ""
    (row,) = (line for line in result.stdout.splitlines() if line.startswith("fault"))
    assert re.search(r"libq_ull_r.*\.so", row) and row.count("libq-ull-r") == 1


COMMANDS = """
import sys
from fusionslam.__main__ import main
for words in (["info", "/nope"], ["config"], ["ros", "check"]):
    sys.argv[1:] = words
    try:
        main()
    except SystemExit as ended:
        assert ended.code == 1
"""


def test_without_the_core_other_commands_point_to_doctor_in_one_line(
    without_library: dict[str, str],
) -> None:
    result = run_python(without_library, "-c", COMMANDS)
    assert result.returncode == 0 and result.stdout == ""
    for line, _ in zip(result.stderr.splitlines(), range(3), strict=True):
        assert line.startswith("error: ") and "fusionslam doctor" in line


def test_the_uses_of_extras_are_those_of_the_commands() -> None:
    found = set()
    for name, command in commands_of(get_command(app)).items():
        if command.callback is None:  # a group
            continue
        source = textwrap.dedent(inspect.getsource(inspect.unwrap(command.callback)))
        for call in ast.walk(ast.parse(source)):
            if isinstance(call, ast.Call) and ast.unparse(call.func) == "needs_extra":
                extras = [each.value for each in call.args if isinstance(each, ast.Constant)]
                found |= {(name, extra) for extra in extras}
    assert {extra for _, extra in found} >= {"map", "report", "sim", "tune", "live", "odometry"}
    for name, extra in found:
        uses = EXTRAS[extra].uses
        assert any(f"{name} ".startswith(f"{use} ") or name in use for use in uses), (name, extra)
