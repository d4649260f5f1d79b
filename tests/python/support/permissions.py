# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Work of other processes, which may do less than this one."""

import ctypes
import os
import traceback
from collections.abc import Callable


def fork(work: Callable[[], object]) -> int:
    """Run something in a child process, which ends with 0 if it succeeds."""
    child = os.fork()
    if not child:
        code = 1
        try:
            work()
            code = 0
        except BaseException:
            traceback.print_exc()
        finally:
            os._exit(code)
    return child


def exit_code_of(child: int) -> int:
    """Wait for a child process: its status, or -signal if it is killed."""
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


def bound_by_permissions(work: Callable[[], object]) -> None:
    """Run something in a child process that may do only what the modes of files allow.

    That of root gives its capabilities away, and stays root: it reads modules wherever they are.
    """

    def run() -> None:
        if os.geteuid() == 0:
            version_3, none = (ctypes.c_uint32 * 2)(0x20080522, 0), (ctypes.c_uint32 * 6)()
            assert ctypes.CDLL(None).capset(version_3, none) == 0
        work()

    assert exit_code_of(fork(run)) == 0
