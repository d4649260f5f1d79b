# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Work that may do less than usual: with fewer rights, with small files, on a full disk."""

import ctypes
import os
import resource
import subprocess
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest


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


@contextmanager
def limited_files(size: int | None) -> Iterator[None]:
    """Let no file become larger; Python ignores the signal, writing fails."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (hard if size is None else size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@contextmanager
def small_disk(folder: Path, size: str) -> Iterator[None]:
    """Mount a file system of a size in a folder; skip the test if that is not allowed."""
    mount = ["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", str(folder)]
    if os.geteuid() != 0 or subprocess.run(mount, capture_output=True).returncode:
        pytest.skip("no file system can be mounted")
    try:
        yield
    finally:
        subprocess.run(["umount", "--lazy", str(folder)], check=True)
