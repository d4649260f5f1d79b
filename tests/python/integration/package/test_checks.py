# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""benchmarks/accuracy/checks.py says pass or fail, and tells a script so."""

import sys
from pathlib import Path

import pytest

from benchmarks.accuracy import checks
from rows import rows


@rows("value, code, verdict", [(9e-5, 0, "pass"), (2e-4, 1, "FAIL")])
def test_a_check_beyond_its_bound_fails(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    value: float,
    code: int,
    verdict: str,
) -> None:
    def rows(_: Path) -> list[object]:
        return [
            checks.largest("distance", value),
            checks.equal("count", "3", "3"),
            checks.Row("beside it", "for comparison", "5", None),
        ]

    monkeypatch.setattr(checks, "checks", rows)
    monkeypatch.setattr(checks, "data_folder", lambda: Path("nowhere"))
    monkeypatch.setattr(sys, "argv", ["checks.py"])
    with pytest.raises(SystemExit) as ended:
        checks.main()
    assert ended.value.code == code
    text = capsys.readouterr().out
    assert f"| distance | 1e-4 | {value:.1e} | {verdict} |" in text
    assert f"{2 - code} of 2 checks passed" in text


def test_without_the_data_it_says_which_variable_names_them(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("FUSIONSLAM_TEST_DATA", str(tmp_path))
    with pytest.raises(SystemExit, match=r"\bFUSIONSLAM_TEST_DATA\b"):
        checks.data_folder()
