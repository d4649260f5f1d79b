# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""A process ends with its own status while daemon threads are in the core."""

import pytest

from fuzz.exits import WORKS, exit_in_the_core


def test_daemon_threads_in_the_core_leave_a_process_its_own_status() -> None:
    assert exit_in_the_core(6) == []


@pytest.mark.nightly
def test_daemon_threads_in_the_core_leave_five_hundred_processes_their_own_status() -> None:
    assert exit_in_the_core(504) == []


def test_the_threads_of_these_processes_do_not_end_by_an_error() -> None:
    for work in WORKS:
        work()
