# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The checks of ``fusionslam doctor``."""

from importlib.metadata import PackageNotFoundError, version

import pytest

from fusionslam import ConfigError
from fusionslam.doctor import Finding, examine


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


def test_a_cache_that_cannot_be_written_is_a_fault(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FUSIONSLAM_CACHE", "/proc/nowhere")
    assert problems(examine()) == {"cache": ("cache-not-writable", [], False)}


def test_an_unknown_level_of_instructions_is_a_fault(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse() -> str:
        raise ConfigError("FUSIONSLAM_SIMD is 'abacus'")

    monkeypatch.setattr("fusionslam.simd_level", refuse)
    assert problems(examine()) == {"instructions": ("unknown-simd-level", [], False)}
