# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Arguments of another type are refused by name where a public function is called."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Literal, cast

import numpy as np
import pytest

import fusionslam
from fusionslam import evaluation, mapping, ratslam, registration, report, views
from fusionslam.base.argument_types import checked
from fusionslam.base.files import PathLike
from fusionslam.datasets import open_bag, open_dataset, write_poses_kitti, write_poses_tum
from fusionslam.errors import ConfigError, DataError, ShapeError
from fusionslam.ratslam.experience_map import quickest_route
from refusals import refuses
from rows import rows


@checked
def annotated(
    count: int = 0,
    size: float = 0.0,
    name: Literal["a", "b"] = "a",
    path: PathLike | None = None,
    names: Sequence[str] = (),
    anything: Any = None,
) -> int:
    return count


ALLOWED: list[dict[str, Any]] = [
    {"count": np.int64(1), "size": 1, "names": ["a"]},
    {"size": np.float32(1), "name": "c", "names": np.array(["a"]), "anything": object()},
    {"path": "missing"},
    {"path": Path("missing"), "names": ()},
]


@rows("given", ALLOWED)
def test_arguments_of_the_annotated_types_are_passed_on(given: dict[str, Any]) -> None:
    assert annotated(**given) == given.get("count", 0)


@rows("name, value", [("count", "1"), ("size", "1"), ("name", 3), ("path", 1), ("names", [1])])
def test_arguments_of_another_type_are_named(name: str, value: Any) -> None:
    with pytest.raises(TypeError, match=rf"^{name}.* is of type .*, expected "):
        annotated(**{name: value})


@rows("name", ["a\0b", "x" * 300, "loop"])
def test_names_that_no_file_can_have_are_refused(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("loop").symlink_to("loop")
    for read in (annotated, open_dataset, open_bag):
        with refuses("bad-path"):
            read(**{"path": name})
    with refuses("bad-path"):
        write_poses_kitti(name, np.eye(4)[None])
    with refuses("bad-path"):
        write_poses_tum(name, np.arange(1), np.eye(4)[None])


OTHERS: list[Callable[[], Any]] = [
    lambda: registration.search_poses(3, 4),
    lambda: registration.compare_images(None, None),
    lambda: evaluation.evaluate_verified(1, [2]),
    lambda: mapping.export_graph("x", 1, 2),
    lambda: fusionslam.fuse("frame"),
    lambda: views.ViewMatcher(comparison=cast(Any, "cm2dp")),
    lambda: ratslam.RatSlam(views=cast(Any, np.eye(3))),
    lambda: ratslam.VisualOdometry().compare(cast(Any, 3), 0),
    lambda: registration.ColorDifference(cast(Any, np.eye(3)), 1.0, 3),
    lambda: fusionslam.LoopDetector("m2dp").resume({}, cast(Any, 3), *[np.arange(3)] * 2),
]


@rows("call", OTHERS)
def test_public_functions_refuse_objects_of_another_type(call: Callable[[], Any]) -> None:
    with pytest.raises(TypeError, match=r" is of type .*, expected |argument"):
        call()


def test_baselines_and_errors_of_trajectories_refuse_what_has_no_answer() -> None:
    nowhere, one = np.zeros((0, 4, 4)), np.eye(4)[None]
    for poses, truth in ((nowhere, nowhere), (one, nowhere), (one[0], one)):
        with pytest.raises(ShapeError):
            evaluation.trajectory_error(poses, truth)
    with pytest.raises(DataError):
        evaluation.trajectory_error(one * np.nan, one)
    with pytest.raises(ConfigError):
        evaluation.always_new(2**31)
    with pytest.raises(ConfigError):
        evaluation.every_kth(3, np.nan)


def test_values_of_odd_types_have_an_answer() -> None:
    links = np.zeros(1, [("source", int), ("target", int), ("duration", float)])
    links["target"] = links["duration"] = 1
    assert quickest_route(links, 2, cast(Any, True), 0).ids == [1, 0]
    assert ratslam.Sighting(0, 1, relative_place=cast(Any, np.eye(2))).measures_place
    with pytest.raises(DataError):
        report.map_figure(cast(Any, np.zeros(0)))
