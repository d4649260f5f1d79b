# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What a run was made with."""

import platform
import subprocess
from datetime import UTC, datetime
from importlib import metadata

import fusionslam
from benchmarks.speed.inputs import ROOT
from benchmarks.speed.peers import native
from fusionslam import _core
from fusionslam.base.machine import machine


def facts() -> dict[str, str]:
    """Machine, versions, compiler, flags, commit and date, each as text."""
    processor, build = machine(), native.build()
    return {
        "date": datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
        "commit": _commit(),
        "CPU": str(processor["cpu"]),
        "cores": str(processor["cores"]),
        "instructions used": fusionslam.simd_level(),
        "system": f"{platform.system()} {platform.release()} ({platform.machine()})",
        "compiler": build["compiler"],
        "flags of fusionslam": build["core_flags"],
        "flags of the peers compiled here": build["peer_flags"],
        "fusionslam": _core.__version__,
        "PCL": build["pcl"],
        "OpenCV": build["opencv"],
        "Eigen": build["eigen"],
        "FAISS": metadata.version("faiss-cpu"),
        "NumPy": metadata.version("numpy"),
        "Python": platform.python_version(),
    }


def _commit() -> str:
    try:
        commit = _git("rev-parse", "--short=12", "HEAD")
        return commit + (" with changes" if _git("status", "--porcelain") else "")
    except (OSError, subprocess.CalledProcessError):
        return "unknown"


def _git(*arguments: str) -> str:
    done = subprocess.run(["git", *arguments], cwd=ROOT, capture_output=True, text=True, check=True)
    return done.stdout.strip()
