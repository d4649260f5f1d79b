# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""One target under Atheris, in a process of its own that a finding may end.

python -m fuzz.worker TARGET FOLDER INPUTS SEED

The counts are in FOLDER/counts, which survives a crash. Exceptions are written to FOLDER/findings
once per cause and do not end the run. libFuzzer ends the process at a crash, a hang or a memory
limit and leaves the input as FOLDER/crash-..., timeout-... or oom-....
"""

import hashlib
import logging
import os
import resource
import sys
import traceback
import warnings
from pathlib import Path

import atheris

with atheris.instrument_imports(include=["fusionslam", "zipfile"], enable_loader_override=False):
    from fuzz.supervisor import libfuzzer_options
    from fuzz.target import SilentError, Target
    from fuzz.targets import find_target
    from fuzz.worker_counts import Counts

ADDRESS_SPACE = 4 << 30  # bytes; what is asked for at once fails before it is touched


class Worker:
    """Counts what becomes of each input."""

    def __init__(self, target: Target, folder: Path, inputs: int) -> None:
        self.target, self.folder, self.left = target, folder, inputs
        self._counts = Counts(folder)

    def process(self, data: bytes) -> None:
        """Process one input; called by Atheris."""
        try:
            accepted = self.target.process(data)
            if accepted is None:
                return
            self._counts.add("accepted" if accepted else "refused")
        except SilentError as error:
            self._keep("silent", data, error)
        except Exception as error:
            self._keep("untyped", data, error)
        self.left -= 1
        if self.left <= 0:
            os._exit(0)  # libFuzzer counts calls, among them those of which no value could be made

    def _keep(self, kind: str, data: bytes, error: Exception) -> None:
        """Count a finding and keep the first input of each cause, told apart by its lines."""
        self._counts.add(kind)
        places = traceback.extract_tb(error.__traceback__)
        cause = "\n".join(
            [type(error).__name__, *(f"{one.filename}:{one.lineno}" for one in places)]
        )
        name = f"{kind}-{hashlib.sha256(cause.encode()).hexdigest()[:12]}"
        findings = self.folder / "findings"
        if not (findings / name).exists():
            findings.mkdir(exist_ok=True)
            (findings / name).write_bytes(data)
            text = "".join(traceback.format_exception(error))
            (findings / f"{name}.txt").write_text(text, encoding="utf-8")


def main() -> None:
    """Run a target until its inputs are used up."""
    name, where, inputs, seed = sys.argv[1:5]
    target, folder = find_target(name), Path(where)
    warnings.simplefilter("ignore")
    logging.disable(logging.CRITICAL)
    resource.setrlimit(resource.RLIMIT_AS, (ADDRESS_SPACE, ADDRESS_SPACE))
    corpus = folder / "corpus"
    seeds = target.seeds()
    for data in seeds:
        (corpus / hashlib.sha256(data).hexdigest()).write_bytes(data)
    largest = target.largest or max(map(len, seeds), default=2048) * 3 // 2
    worker = Worker(target, folder, int(inputs))
    options = libfuzzer_options(folder, int(seed), largest)
    atheris.Setup([sys.argv[0], *options], worker.process, internal_libfuzzer=True)
    atheris.Fuzz()


if __name__ == "__main__":
    main()
