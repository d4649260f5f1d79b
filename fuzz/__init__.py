# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Fuzzing of all that reads files or takes arrays; see docs/results/robustness.md.

``python -m fuzz --help``. ``stored_formats`` and ``foreign_files`` are the targets of bytes,
``public_functions`` those of arguments, ``worker`` runs one target under Atheris (coverage-guided)
in a process of its own, ``supervisor`` starts workers and counts what they found. Apart from them,
``any_arguments`` calls every public name with values of any type.
"""

import sys
from pathlib import Path

PROJECT = Path(__file__).resolve().parents[1]

# The tests' makers of small clouds, drives and maps are the seeds here.
sys.path.insert(0, str(PROJECT / "tests" / "python" / "support"))
