# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The names that others rely on, and what importing the package costs."""

import ast
import inspect
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fusionslam
from arrays import COLORS, IMAGE, POINTS, PROJECTION, RNG
from project import PROJECT
from rows import rows


def test_colorize_gives_points_colours_and_indices() -> None:
    points, colors, indices = fusionslam.colorize(POINTS, IMAGE, PROJECTION)
    assert points.shape == colors.shape == (len(indices), 3)
    assert (points.dtype, colors.dtype, indices.dtype) == (np.float32, np.uint8, np.int64)


@rows(
    "function, arguments",
    [
        (fusionslam.m2dp, (POINTS, "robust")),
        (fusionslam.m2dp_signature, (POINTS, "robust")),
        (fusionslam.cm2dp, (POINTS, COLORS, "rgb")),
        (fusionslam.shot, (POINTS, 0.5)),
        (fusionslam.cshot, (POINTS, COLORS, 0.5)),
    ],
)
def test_options_are_keywords_only(function: Callable[..., Any], arguments: tuple[Any]) -> None:
    with pytest.raises(TypeError):
        function(*arguments)


def test_precision_recall_has_the_promised_signature_and_fields() -> None:
    function = fusionslam.evaluation.precision_recall
    parameters = inspect.signature(function).parameters
    assert list(parameters)[:2] == ["descriptors", "positions"]
    defaults = {name: parameters[name].default for name in ("protocol", "radius", "window")}
    assert defaults == {"protocol": "revisit", "radius": None, "window": None}
    for name in defaults:
        assert parameters[name].kind is inspect.Parameter.KEYWORD_ONLY
    lap = np.r_[np.arange(60), np.arange(60)]
    descriptors = RNG.normal(size=(60, 8)).astype(np.float32)[lap]
    positions = np.c_[20.0 * lap, 0 * lap, 0 * lap]
    curve = function(descriptors, positions)
    assert (curve.radius, curve.window) == (10.0, 50)  # the protocol's
    for name in ("thresholds", "precision", "recall"):
        assert len(getattr(curve, name)) == len(curve.thresholds)
    for name in ("recall_at_full_precision", "max_f1", "average_precision", "top1"):
        assert 0.99 < float(getattr(curve, name)) <= 1, name


def test_open_dataset_takes_a_path(tmp_path: Path) -> None:
    assert next(iter(inspect.signature(fusionslam.open_dataset).parameters)) == "path"
    with pytest.raises(fusionslam.DataError, match="nowhere"):
        fusionslam.open_dataset(tmp_path / "nowhere")


@rows("name", fusionslam.__all__)
def test_every_public_name_is_there_and_documented(name: str) -> None:
    value = getattr(fusionslam, name)
    assert name in dir(fusionslam)
    if callable(value):
        assert value.__doc__, name


def test_a_name_that_is_not_there_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="m3dp"):
        _ = fusionslam.m3dp


def test_the_version_is_that_of_the_build_file() -> None:
    found = re.search(r"VERSION (\d+\.\d+\.\d+)", (PROJECT / "CMakeLists.txt").read_text())
    assert found and fusionslam.__version__ == found[1]


def test_errors_are_one_family() -> None:
    for error in (fusionslam.DataError, fusionslam.ConfigError, fusionslam.ShapeError):
        assert issubclass(error, fusionslam.FusionSlamError) and issubclass(error, ValueError)


HEAVY = {"matplotlib", "embreex", "trimesh", "torch", "sklearn", "scipy", "pandas", "jinja2"}


def modules_after(program: str) -> set[str]:
    """Top-level modules that a fresh Python has loaded after a program."""
    code = f"import sys\n{program}\nprint(*{{name.partition('.')[0] for name in sys.modules}})"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return set(run.stdout.split())


def test_importing_the_package_loads_next_to_nothing() -> None:
    loaded = modules_after("import fusionslam")
    assert "fusionslam" in loaded
    assert not loaded & (HEAVY | {"numpy", "PIL", "pydantic", "yaml", "typer", "rich"})


def test_type_checkers_see_the_names_that_are_loaded_when_used() -> None:
    tree = ast.parse((PROJECT / "python/fusionslam/__init__.py").read_text(encoding="utf-8"))
    (block,) = (
        node for node in tree.body if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.dump(node)
    )
    imported = {
        (f"{node.module}.{alias.name}", alias.asname)
        for node in block.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    lazy = {(f"fusionslam.{home}.{name}", name) for name, home in fusionslam._HOME_OF.items()}
    assert imported == lazy | {(f"fusionslam.{name}", name) for name in fusionslam._PACKAGES}


def test_using_the_package_loads_nothing_heavy() -> None:
    loaded = modules_after(
        "import fusionslam as f\n"
        "f.m2dp, f.LoopDetector, f.open_dataset, f.PipelineConfig, f.evaluation.precision_recall"
    )
    assert "numpy" in loaded and not loaded & HEAVY


def test_every_source_begins_with_its_licence() -> None:
    lines = [
        "SPDX-FileCopyrightText: 2026 The fusionslam authors",
        "SPDX-License-Identifier: Apache-2.0",
    ]
    sources = [
        path
        for folder in ("python/fusionslam", "tests", "cpp", "bindings", "examples", "benchmarks")
        for suffix in ("py", "cpp", "hpp")
        for path in (PROJECT / folder).rglob(f"*.{suffix}")
    ]
    assert len(sources) > 20
    for path in sources:
        head = path.read_text(encoding="utf-8").splitlines()[:3]
        assert all(any(line in row for row in head) for line in lines), path
