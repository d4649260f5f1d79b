# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Every code block of the documentation names its language; blocks that do not run say why.

The blocks themselves are run by the ``conftest.py`` of the project.
"""

import re
from collections import Counter
from pathlib import Path

PROJECT = Path(__file__).parents[3]
PAGES = [PROJECT / "README.md", PROJECT / "CONTRIBUTING.md", *(PROJECT / "docs").rglob("*.md")]
LANGUAGES = {"bash", "cmake", "cpp", "python", "text", "yaml"}
REASONS = {
    "builds the project",
    "installs packages",
    "needs a robot with ROS 1",
    "needs files of a reader",
    "needs the class in the package",
    "runs all tests",
    "takes hours",
    "takes minutes",
}
FENCE = re.compile(r"^ *```(\S*)", re.MULTILINE)
MARKER = re.compile(r"<!--+ *skip(.*?)-->(?:\s*```)?", re.DOTALL)
MOST_SKIPPED = 28


def test_every_code_block_names_a_language_that_is_run_or_is_text() -> None:
    for page in PAGES:
        opening = FENCE.findall(page.read_text(encoding="utf-8"))[::2]
        assert set(opening) <= LANGUAGES, page


def test_ctest_builds_every_block_of_cpp_and_cmake() -> None:
    written = [
        (page.name, language)
        for page in PAGES
        for language in FENCE.findall(page.read_text(encoding="utf-8"))
        if language in {"cpp", "cmake"}
    ]
    consumer = (PROJECT / "tests/cpp/consumer.cmake").read_text(encoding="utf-8")
    built = re.findall(r'^read_block\(".*" (cpp|cmake) \w+\)$', consumer, re.MULTILINE)
    assert Counter(written) == Counter(("cpp.md", language) for language in built)


def test_blocks_that_do_not_run_have_a_known_reason() -> None:
    reasons = Counter[str]()
    for page in PAGES:
        for marker in MARKER.finditer(page.read_text(encoding="utf-8")):
            reason = re.fullmatch(r': next "(.*)" ', marker[1])
            assert reason and reason[1] in REASONS, f"{page}: {marker[0]}"
            assert marker[0].endswith("```"), f"{page}: no code block after {marker[0]}"
            reasons[reason[1]] += 1
    assert set(reasons) == REASONS
    assert reasons.total() <= MOST_SKIPPED, reasons
