# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Runs workers, starts them again where a finding ended them, and adds up what they found."""

import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import asdict, dataclass, field
from pathlib import Path

from fuzz import PROJECT
from fuzz.worker_counts import read_counts

CORE = "core/"
CORE_BINARIES = PROJECT / "build" / "fuzz" / "fuzz" / "core"
# libFuzzer's names of what it leaves behind.
ARTIFACTS = {"crash-": "crashes", "timeout-": "hangs", "oom-": "memory"}
RESTARTS = 10


@dataclass
class Outcome:
    """What one target did with its inputs.

    Attributes:
        accepted, refused, silent, untyped: numbers of inputs.
        crashes, hangs, memory: numbers of ends of the process.
        findings: files that the runs left.
        commits: of the code that was tried.
    """

    target: str
    accepted: int = 0
    refused: int = 0
    silent: int = 0
    untyped: int = 0
    crashes: int = 0
    hangs: int = 0
    memory: int = 0
    findings: list[str] = field(default_factory=list)
    commits: list[str] = field(default_factory=list)

    @property
    def inputs(self) -> int:
        """Number of inputs tried, those that ended the process among them."""
        alive = self.accepted + self.refused + self.silent + self.untyped
        return alive + self.crashes + self.hangs + self.memory


def core_targets() -> list[str]:
    """Names of the targets of the C++ core that were built."""
    return [CORE + path.name.removeprefix("fuzz_") for path in sorted(CORE_BINARIES.glob("fuzz_*"))]


def run_targets(
    inputs: Mapping[str, int], folder: Path, *, jobs: int, seed: int, resume: bool = False
) -> Iterator[Outcome]:
    """Run targets with so many inputs each, ``jobs`` at a time; yields outcomes as they come.

    ``resume`` counts the inputs that the folder holds of targets without a finding.
    """
    with ThreadPoolExecutor(jobs) as pool:
        futures = [
            pool.submit(_run_target, name, count, folder, seed, resume)
            for name, count in inputs.items()
        ]
        for future in as_completed(futures):
            yield future.result()


def _run_target(name: str, inputs: int, folder: Path, seed: int, resume: bool) -> Outcome:
    """Run one target until it has had its inputs, or ended too often, and store the outcome."""
    where = folder / name.replace("/", "-")
    stored = where / "outcome.json"
    outcome = Outcome(**json.loads(stored.read_bytes())) if stored.exists() else Outcome(name)
    if not resume or not stored.exists() or outcome.findings:
        outcome = Outcome(name)
        shutil.rmtree(where / "findings", ignore_errors=True)
        for old in [where / "counts", where / "log.txt", stored, *_artifacts(where)]:
            old.unlink(missing_ok=True)
    (where / "corpus").mkdir(parents=True, exist_ok=True)
    if outcome.inputs >= inputs:
        return outcome
    outcome.commits = sorted({*outcome.commits, _commit()})
    for _ in range(RESTARTS):
        # Another seed each time: the same one would choose many of the same inputs again.
        status = _run(name, where, inputs - outcome.inputs, seed + outcome.inputs)
        _count(outcome, where)
        if status == 0 or outcome.inputs >= inputs:
            break
    outcome.findings += map(str, sorted((where / "findings").glob("*.txt")))
    stored.write_text(json.dumps(asdict(outcome), indent=1), encoding="utf-8")
    return outcome


def _commit() -> str:
    command = ["git", "describe", "--always", "--dirty"]
    run = subprocess.run(command, cwd=PROJECT, capture_output=True, text=True)
    return run.stdout.strip() or "unknown"


def _run(name: str, where: Path, inputs: int, seed: int) -> int:
    if name.startswith(CORE):
        binary = CORE_BINARIES / f"fuzz_{name.removeprefix(CORE)}"
        command = [str(binary), *libfuzzer_options(where, seed, 4096), f"-runs={inputs}"]
    else:
        command = [sys.executable, "-m", "fuzz.worker", name, str(where), str(inputs), str(seed)]
    memory = Path("/dev/shm")
    with (
        (where / "log.txt").open("ab") as log,
        tempfile.TemporaryDirectory(dir=memory if memory.is_dir() else None) as scratch,
    ):
        environment = {**os.environ, "TMPDIR": scratch}
        run = subprocess.run(command, cwd=PROJECT, env=environment, stdout=log, stderr=log)
    return run.returncode


def libfuzzer_options(where: Path, seed: int, largest: int) -> list[str]:
    """Options of libFuzzer, which Atheris has, too."""
    return [
        f"-seed={seed}",
        f"-max_len={largest}",
        "-timeout=20",
        "-rss_limit_mb=2048",
        f"-artifact_prefix={where}/",
        "-len_control=0",
        "-print_final_stats=1",
        str(where / "corpus"),
    ]


def _count(outcome: Outcome, where: Path) -> None:
    artifacts = _artifacts(where)
    for kind in ARTIFACTS.values():
        found = [path for path in artifacts if ARTIFACTS[f"{path.name.split('-')[0]}-"] == kind]
        setattr(outcome, kind, len(found))
    outcome.findings = [str(path) for path in artifacts]
    if outcome.target.startswith(CORE):
        log = (where / "log.txt").read_text(errors="replace")
        runs = re.findall(r"stat::number_of_executed_units: (\d+)", log)
        outcome.refused = sum(map(int, runs))  # the C++ targets do not say what they accepted
    else:
        outcome.accepted, outcome.refused, outcome.silent, outcome.untyped = read_counts(where)


def _artifacts(folder: Path) -> list[Path]:
    return sorted(path for prefix in ARTIFACTS for path in folder.glob(f"{prefix}*"))
