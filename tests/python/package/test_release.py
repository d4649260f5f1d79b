# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What packages and releases contain."""

import re
import subprocess
import sys
from pathlib import Path

PROJECT = Path(__file__).resolve().parents[3]


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
