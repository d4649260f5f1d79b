# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What is said when torch or onnxruntime is missing, and what works without them."""

import subprocess
import sys

import pytest

from rows import rows

HIDDEN = """
import sys
for name in {names!r}:
    sys.modules[name] = None
from rows import rows
from fusionslam.errors import FusionSlamError
try:
    {statement}
except FusionSlamError as error:
    print(error)
"""


def without(names: list[str], statement: str) -> str:
    """What a Python without these modules prints."""
    code = HIDDEN.format(names=names, statement=statement)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr
    return done.stdout


@rows("module", ["training_loop", "pointnet", "train", "onnx_export", "weight_files"])
def test_training_without_torch_names_the_extra(module: str) -> None:
    said = without(["torch"], f"import fusionslam.learning.{module}")
    assert "needs torch" in said and "pip install 'fusionslam[learn]'" in said


def test_the_second_stage_without_onnxruntime_names_the_extra() -> None:
    said = without(
        ["onnxruntime"], "from fusionslam.views.second_stage import SecondStage; SecondStage()"
    )
    assert "needs onnxruntime" in said and "pip install 'fusionslam[onnx]'" in said


def test_hdf5_files_without_h5py_name_the_extra() -> None:
    said = without(
        ["h5py"],
        "from fusionslam.learning.modelnet import _read_arrays; from pathlib import Path;"
        "_read_arrays(Path('x.h5'))",
    )
    assert "need h5py" in said and "pip install 'fusionslam[learn]'" in said


def test_the_second_stage_needs_no_torch() -> None:
    pytest.importorskip("onnxruntime", reason="onnxruntime is not installed")
    said = without(
        ["torch", "onnx", "safetensors", "h5py", "matplotlib"],
        "import numpy as np; from fusionslam.views.second_stage import SecondStage;"
        "stage = SecondStage('thesis');"
        "print(stage.features(np.ones((5, 3), np.float32)).shape)",
    )
    assert said.strip() == "(256,)"
