# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What is said when torch or onnxruntime is missing, and what works without them."""

import subprocess
import sys

import pytest

HIDDEN = """
import sys
for name in {names!r}:
    sys.modules[name] = None
from fusionslam.errors import FusionSlamError
for statement in {statements!r}:
    try:
        exec(statement)
    except FusionSlamError as error:
        print(error)
"""


def without(names: list[str], *statements: str) -> list[str]:
    """What a Python without these modules prints."""
    code = HIDDEN.format(names=names, statements=statements)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


def test_what_needs_a_library_that_is_missing_names_its_extra() -> None:
    modules = ("training_loop", "pointnet", "train", "onnx_export", "weight_files")
    said = without(
        ["torch", "onnxruntime", "h5py"],
        *(f"import fusionslam.learning.{module}" for module in modules),
        "from fusionslam.views.second_stage import SecondStage; SecondStage()",
        "from fusionslam.learning.modelnet import _read_arrays; from pathlib import Path;"
        "_read_arrays(Path('x.h5'))",
    )
    needs = [*["needs torch"] * len(modules), "needs onnxruntime", "need h5py"]
    extras = [*["learn"] * len(modules), "onnx", "learn"]
    for line, need, extra in zip(said, needs, extras, strict=True):
        assert need in line and f"pip install 'fusionslam[{extra}]'" in line


def test_the_second_stage_needs_no_torch() -> None:
    pytest.importorskip("onnxruntime", reason="onnxruntime is not installed")
    said = without(
        ["torch", "onnx", "safetensors", "h5py", "matplotlib"],
        "import numpy as np; from fusionslam.views.second_stage import SecondStage;"
        "stage = SecondStage('thesis');"
        "print(stage.features(np.ones((5, 3), np.float32)).shape)",
    )
    assert said == ["(256,)"]
