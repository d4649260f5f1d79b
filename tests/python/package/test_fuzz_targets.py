# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""A short run of every target of fuzz/: damaged files, forged files, hostile arguments."""

import pytest

from fuzz.short_run import FORMER_FINDINGS, short_run
from fuzz.targets import all_targets

TARGETS = all_targets()


@pytest.mark.parametrize("name", TARGETS)
def test_hostile_input_is_refused_or_harmless(name: str) -> None:
    assert short_run(TARGETS[name], 30) >= 10


def test_every_former_finding_belongs_to_a_target() -> None:
    folders = {folder.name for folder in FORMER_FINDINGS.glob("*")}
    assert folders <= {name.replace("/", "-") for name in TARGETS}
