# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The registry says of each descriptor what is so, and the documentation repeats it."""

import os
import re
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from numpy.typing import NDArray

import fusionslam
from descriptor_runs import descriptor_run
from error_codes import has_code
from fusionslam import (
    Cloud,
    ConfigError,
    DataError,
    DescriptorConfig,
    DescriptorIndex,
    LoopDetector,
)
from fusionslam.descriptors import (
    DESCRIPTORS,
    USUAL,
    Descriptor,
    computation,
    describe,
    length_of,
    load_descriptor,
    own,
)
from fusionslam.descriptors.own import GROUP, VARIABLE
from fusionslam.descriptors.registry import POINT_DATA
from project import PROJECT
from refusals import refuses
from rows import rows

PAGE = PROJECT / "docs" / "stages" / "descriptors.md"
KINDS = list(DESCRIPTORS.values())


@cache
def rows_of_page() -> dict[str, list[str]]:
    """Cells of the table of descriptors by name."""
    table = PAGE.read_text().partition("<!-- registry:")[2].partition("\n\n")[0]
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in table.splitlines()[3:]]
    return {row[0].strip("`"): row[1:] for row in rows}


@cache
def courtyard(seed: int = 0) -> Cloud:
    """Walls, a floor and posts about the scanner, seen 2 m above the ground."""
    rng = np.random.default_rng(seed)
    floor = np.column_stack([rng.uniform(-20, 20, (9000, 2)), rng.normal(-1.9, 0.02, 9000)])
    walls = []
    for _ in range(8):
        x, y, turn, length = *rng.uniform(-18, 18, 2), rng.uniform(0, np.pi), rng.uniform(4, 12)
        along, up = rng.uniform(0, length, 1500), rng.uniform(-1.9, 4, 1500)
        walls.append(np.column_stack([x + along * np.cos(turn), y + along * np.sin(turn), up]))
    points = np.concatenate([floor, *walls]).astype(np.float32)
    colors = rng.integers(0, 256, (len(points), 3), dtype=np.uint8)
    return Cloud(points, colors, rng.uniform(0.1, 1, len(points)).astype(np.float32))


def test_the_page_has_a_row_of_each_descriptor() -> None:
    assert list(rows_of_page()) == list(DESCRIPTORS)


@rows("kind", KINDS)
def test_rows_of_the_page_are_those_of_the_registry(kind: Descriptor) -> None:
    length, invariant_to, needs, metric, _, source = rows_of_page()[kind.name]
    assert int(re.match(r"\d+", kind.length)[0]) == int(length)
    assert invariant_to == ", ".join(kind.invariant_to)
    assert needs == ", ".join(kind.needs)
    assert metric == f"`{kind.metric}`"
    assert source == kind.source
    assert DescriptorIndex(int(length), metric=kind.metric).metric == kind.metric


@rows("kind", [kind for kind in KINDS if kind.extends is not None])
def test_extended_descriptors_need_no_point_data(kind: Descriptor) -> None:
    assert DESCRIPTORS[kind.extends].point_data == ()
    assert DESCRIPTORS[kind.extends].metric == kind.metric


@pytest.mark.parametrize("kind", KINDS, ids=list(DESCRIPTORS))
def test_a_descriptor_keeps_what_the_registry_says(kind: Descriptor) -> None:
    """Its length for any cloud and any number of threads; an index finds the same cloud first."""
    courtyards = [courtyard(seed) for seed in range(3)]
    table = [describe(each, kind.name) for each in courtyards]
    several = describe(courtyards[0], kind.name, DescriptorConfig(threads=4))
    np.testing.assert_array_equal(several, table[0])
    length = length_of(kind.name, DescriptorConfig())
    assert length == int(re.match(r"\d+", kind.length)[0])
    index = DescriptorIndex(length, metric=kind.metric)
    for row in table:
        assert row.dtype == np.float32
        assert np.isfinite(row).all()
        assert row.any()
        index.add(row)
    for number, row in enumerate(table):
        found, distances = index.query(row, k=3)
        assert found[0] == number
        assert distances[0] == pytest.approx(0, abs=1e-3)
        assert distances[1] > 1e-3


@rows("kind", KINDS)
def test_clouds_that_are_empty_or_nan_or_lack_what_is_needed_are_refused(kind: Descriptor) -> None:
    whole = courtyard()
    for need in kind.point_data:
        given = {"colors": whole.colors, "intensities": whole.intensities, need: None}
        with pytest.raises(DataError, match=f"{kind.name} needs {POINT_DATA[need]}") as caught:
            describe(Cloud(whole.points, **given), kind.name)
        assert caught.value.code == f"no-{need}"
    for points in (np.empty((0, 3), np.float32), np.full((100, 3), np.nan, np.float32)):
        colors, intensities = np.zeros(points.shape, np.uint8), np.ones(len(points), np.float32)
        with pytest.raises(DataError):
            describe(Cloud(points, colors, intensities), kind.name)


def test_usual_descriptors_are_known() -> None:
    assert set(USUAL) <= set(DESCRIPTORS)
    assert all(hasattr(fusionslam, name) for name in USUAL)


def ranges(points: NDArray[np.float32]) -> NDArray[np.float32]:
    return np.histogram(np.linalg.norm(points, axis=1), 20, (0, 60))[0].astype(np.float32)


def reds(points: NDArray[np.float32], colors: NDArray[np.uint8]) -> list[float]:
    return [float(len(points)), float(colors[:, 0].mean())]


@pytest.fixture
def own_module(monkeypatch: pytest.MonkeyPatch) -> Iterator[ModuleType]:
    """A user's module of the name ``mine``, of which nobody has heard yet; a page has another."""
    monkeypatch.setattr(computation, "_OWN_LENGTHS", {})
    _forget_own()
    module = ModuleType("mine")
    vars(module).update(ranges=ranges, numbers=[1.0])
    vars(module).update(
        reds=Descriptor(name="reds", length="2", source="", needs=("colors",), function=reds),
        raises=lambda points: points["x"],
        flat=lambda points: points,
        empty=lambda points: [],
        nan=lambda points: [np.nan],
        large=lambda points: [1e300],
        growing=lambda points: np.ones(len(points)),
        lacking=Descriptor(name="lacking", length="2", source=""),
    )
    monkeypatch.setitem(sys.modules, "mine", module)
    monkeypatch.setattr(sys, "path", [*sys.path])
    monkeypatch.setenv(VARIABLE, "")
    yield module
    _forget_own()


def _forget_own() -> None:
    for cached in (own._import, own._installed, computation._length_of):
        cached.cache_clear()


def test_a_descriptor_of_a_users_module_is_one_like_any_other(own_module: ModuleType) -> None:
    assert load_descriptor("mine:ranges").metric == "l2"
    np.testing.assert_array_equal(describe(courtyard(), "mine:ranges"), ranges(courtyard().points))
    assert length_of("mine:ranges", DescriptorConfig()) == 20
    load_descriptor("mine:reds")
    assert os.environ[VARIABLE] == "mine:ranges,mine:reds"  # for processes that this one starts
    assert describe(courtyard(), "mine:reds")[0] == len(courtyard())
    with refuses("no-colors"):
        describe(Cloud(courtyard().points), "mine:reds")
    detector = LoopDetector("mine:ranges", verify=False, threshold=1.0, window=1)
    found = [detector.add(courtyard(seed)) for seed in (1, 2, 1)]
    assert [loop and loop.match for loop in found] == [None, None, 0]


@rows(
    "name, code",
    [
        ("mine:unknown", "own-descriptor"),
        ("mine:numbers", "own-descriptor"),
        ("mine:lacking", "own-descriptor"),
        ("no_such_module:ranges", "own-descriptor"),
        ("mine.py:ranges", "own-descriptor"),
        ("mine:no function", "unknown-name"),
        ("mine", "unknown-name"),
        ("m" * 1_000_000, "unknown-name"),
        ("m" * 100 + ":" + "m" * 100, "unknown-name"),
    ],
)
def test_names_of_no_function_are_refused(own_module: ModuleType, name: str, code: str) -> None:
    with pytest.raises(ConfigError, check=has_code(code)) as caught:
        load_descriptor(name)
    assert len(str(caught.value)) < 1000


@rows("function", ["raises", "flat", "empty", "nan", "large", "growing"])
def test_what_a_users_function_must_not_do_is_refused(
    own_module: ModuleType, function: str
) -> None:
    load_descriptor(f"mine:{function}")
    with refuses("own-descriptor", f"mine:{function}"):
        for points in (courtyard().points, courtyard().points[:-1]):
            describe(Cloud(points), f"mine:{function}")


def test_a_name_in_a_file_imports_nothing(own_module: ModuleType) -> None:
    with refuses("unknown-name", "descriptors", "mine:ranges", error=ConfigError):
        LoopDetector("mine:ranges")
    run = descriptor_run(np.ones((3, 20)), descriptor="mine:ranges")
    with refuses("unknown-name", error=ConfigError):
        _ = run.metric
    load_descriptor("mine:ranges")
    assert run.metric == "l2"


def test_installed_packages_declare_descriptors(
    own_module: ModuleType, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    package = tmp_path / "mine-1.0.dist-info"
    package.mkdir()
    (package / "METADATA").write_text("Metadata-Version: 2.1\nName: mine\nVersion: 1.0\n")
    (package / "entry_points.txt").write_text(f"[{GROUP}]\nmy_ranges = mine:ranges\n")
    monkeypatch.syspath_prepend(tmp_path)
    assert len(describe(courtyard(), "my_ranges")) == 20
    assert LoopDetector("my_ranges", verify=False, threshold=1.0).descriptor == "my_ranges"
