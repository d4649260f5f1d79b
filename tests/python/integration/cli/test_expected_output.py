# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Help, results and mistakes of each command, word for word.

After a change that is meant, run ``update_expected.py`` beside this file and read its diff.
"""

from pathlib import Path

import pytest

from expected_output import EXPECTED, transcript

NEEDED = {
    **dict.fromkeys(("info", "fuse"), "rosbags"),
    **dict.fromkeys(("sim", "demo"), "embreex"),
    **dict.fromkeys(("bench", "bench_views", "report", "views_match", "views_show"), "matplotlib"),
    "fleet": "lancedb",
    "tune": "pymoo",
    "serve": "fastapi",
}
"""The optional package without which a command says something else."""


NAMES = [
    pytest.param(path.stem, marks=[pytest.mark.slow] if path.stem == "fleet" else [])
    for path in sorted(EXPECTED.glob("*.txt"))
]


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_a_command_prints_what_is_expected(name: str, tmp_path: Path) -> None:
    pytest.importorskip(NEEDED.get(name, "numpy"))
    expected = (EXPECTED / f"{name}.txt").read_text()
    assert transcript(expected, tmp_path) == expected
