# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Software versions and machine that a result was made with."""

import platform
from collections.abc import Callable
from contextlib import suppress
from importlib import metadata
from pathlib import Path

from fusionslam.base.parallel import available_cores


def versions() -> dict[str, str]:
    """Versions of fusionslam, NumPy, Python and the operating system."""
    return {
        "fusionslam": _version("fusionslam"),
        "numpy": _version("numpy"),
        "python": platform.python_version(),
        "system": f"{platform.system()} {platform.release()} ({platform.machine()})",
    }


def machine() -> dict[str, str | int]:
    """The processor's name and the number of cores that this process may use."""
    lines: list[str] = []
    with suppress(OSError):
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    named = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    cpu = next(named, platform.processor() or platform.machine())
    return {"cpu": cpu, "cores": available_cores()}


def _version(package: str) -> str:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return "not installed"


def peak_memory(work: Callable[[], object]) -> int:
    """Peak resident memory of ``work`` in bytes, beyond what is in use before it (Linux).

    0 if the kernel does not report it.
    """
    release_memory()
    try:
        Path("/proc/self/clear_refs").write_text("5")
        before = _status_bytes("VmRSS")
        work()
        return max(_status_bytes("VmHWM") - before, 0)
    except OSError:
        return 0


def release_memory() -> None:
    """Give memory that is free back to the system, where the C library can (glibc).

    It keeps what lies between blocks in use otherwise: clouds that come and go beside what is kept
    for good let a process grow by far more than what is kept.
    """
    import ctypes

    with suppress(OSError, AttributeError):
        ctypes.CDLL("libc.so.6").malloc_trim(0)


def _status_bytes(key: str) -> int:
    lines = Path("/proc/self/status").read_text().splitlines()
    found = next(line for line in lines if line.startswith(f"{key}:"))
    return int(found.split()[1]) * 1024
