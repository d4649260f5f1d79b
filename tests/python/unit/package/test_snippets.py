# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Every code block of the documentation names its language; blocks that do not run say why.

The blocks themselves are run by the ``conftest.py`` of the project.
"""

import re
from collections import Counter

from project import PROJECT

PAGES = [PROJECT / "README.md", PROJECT / "CONTRIBUTING.md", *(PROJECT / "docs").rglob("*.md")]
LANGUAGES = {"bash", "cmake", "cpp", "python", "text", "yaml"}
BY_CTEST = "runs in ctest"
REASONS = {BY_CTEST, "builds the project", "installs packages"}
FENCE = re.compile(r"^ *```(\S*)", re.MULTILINE)
MARKER = re.compile(r"<!--+ *skip(.*?)-->(?:\s*```)?", re.DOTALL)
MOST_SKIPPED = 5


def test_every_code_block_names_a_language_that_is_run_or_is_text() -> None:
    for page in PAGES:
        opening = FENCE.findall(page.read_text(encoding="utf-8"))[::2]
        assert set(opening) <= LANGUAGES, page


def test_ctest_runs_every_block_of_cpp_and_cmake_and_those_that_say_so() -> None:
    written = Counter[tuple[str, str]]()
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        languages = [name for name in FENCE.findall(text) if name in {"cpp", "cmake"}]
        languages += ["bash"] * text.count(f'<!-- skip: next "{BY_CTEST}" -->')
        written.update((page.name, language) for language in languages)
    consumer = (PROJECT / "tests/cpp/consumer.cmake").read_text(encoding="utf-8")
    built = re.findall(r'^ *read_block\(".*" (\w+) \w+\)$', consumer, re.MULTILINE)
    assert written == Counter(("cpp.md", language) for language in built)


def test_pages_name_targets_of_the_makefile_and_scripts_that_exist() -> None:
    makefile = (PROJECT / "Makefile").read_text(encoding="utf-8")
    targets = set(re.findall(r"^([a-z0-9-]+):", makefile, re.MULTILINE))
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        named = set(re.findall(r"(?:^|`)make (?:[A-Z]+=\S+ )*([a-z0-9-]+)", text, re.MULTILINE))
        assert named <= targets, page
        for script in re.findall(r"(?:^|`)(?:\.\./)*(scripts/\w+\.sh)", text, re.MULTILINE):
            assert (PROJECT / script).is_file(), f"{page}: {script}"


def test_blocks_that_do_not_run_have_a_known_reason() -> None:
    reasons = Counter[str]()
    for page in PAGES:
        for marker in MARKER.finditer(page.read_text(encoding="utf-8")):
            reason = re.fullmatch(r': next "(.*)" ', marker[1])
            assert reason and reason[1] in REASONS, f"{page}: {marker[0]}"
            assert marker[0].endswith("```"), f"{page}: no code block after {marker[0]}"
            reasons[reason[1]] += 1
    assert set(reasons) == REASONS
    del reasons[BY_CTEST]
    assert reasons.total() <= MOST_SKIPPED, reasons
