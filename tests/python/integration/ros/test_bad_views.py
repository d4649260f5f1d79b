# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Bad input to the nodes that recognise places, and what they keep in files."""

import shutil
from collections.abc import Callable
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from error_codes import has_code
from fusionslam.errors import ConfigError, DataError
from fusionslam.sensors.messages import Picture, Scan
from permissions import limited_files
from refusals import refuses
from ros_master import needs_ros
from ros_node import CLOUDS, IDS, VIEWS, Desk, causes, colored_cloud, ids
from rows import rows

pytestmark = needs_ros

IMAGES, LOOPS = "camera/rgb/image_raw", "loop_closures"
S = 1_000_000_000


def cloud(k: int) -> Scan:
    """Of place k, seen k seconds after the start."""
    points, colors = colored_cloud()
    points[len(points) // 2 :, 1] += 0.9 * (k % 3)
    return Scan(stamp_ns=S * (k + 1), frame_id="base", points=points, colors=colors)


def views(count: int, first: int = 0, **parameters: Any) -> list[Any]:
    builder = Desk("lv_builder", **parameters)
    builder.give(CLOUDS, *map(cloud, range(first, first + count)))
    return builder.outlet.of(VIEWS)


def empty(scan: Scan) -> Scan:
    return replace(scan, points=scan.points[:0], colors=scan.colors[:0])


def of_nan(scan: Scan) -> Scan:
    return replace(scan, points=scan.points * np.float32(np.nan))


def short(scan: Scan) -> Any:
    from fusionslam.ros.messages.library import build

    message = build(scan)
    message.data = message.data[:-1]
    return message


SPOILED: list[tuple[Callable[[Scan], Any], str]] = [
    (lambda scan: replace(scan, colors=None), "no-colours"),
    (empty, "empty-cloud"),
    (of_nan, "empty-cloud"),
    (lambda scan: replace(scan, stamp_ns=0), "no-stamp"),
    (short, "DataError"),
    (lambda scan: picture(1), "wrong-type"),
]


@rows("case, node", product(SPOILED, ["lv_builder", "loop_closure"]))
def test_clouds_that_nothing_can_be_recognised_by(
    case: tuple[Callable[[Scan], Any], str], node: str, caplog: pytest.LogCaptureFixture
) -> None:
    spoil, cause = case
    desk = Desk(node)
    desk.outlet.wanted = {"clustered_viz", "convex_hull_viz"}
    desk.give(CLOUDS, cloud(0), spoil(cloud(1)), spoil(cloud(2)), cloud(3))
    assert causes(caplog) == [cause] and [*desk.problems().values()] == [2]
    done = {"lv_builder": "views", "loop_closure": "clouds"}[node]
    is_view = node == "lv_builder" and spoil in (empty, of_nan)
    assert desk.node.report()[done] == 2 + 2 * is_view


@rows("source", ["alignment", "objects", "cm2dp"])
def test_a_scan_without_anything_gives_no_place_and_is_not_kept(source: str) -> None:
    builder, matcher = Desk("lv_builder", source=source), Desk("lv_matching", source=source)
    builder.give(CLOUDS, cloud(0), empty(cloud(1)), cloud(3))
    matcher.give(VIEWS, *builder.outlet.of(VIEWS))
    assert ids(matcher) == [0, -1, 0]


def test_views_of_another_configuration_or_damaged_leave_the_memory_as_it_was(
    caplog: pytest.LogCaptureFixture,
) -> None:
    matcher, good = Desk("lv_matching"), views(3)
    damaged, nothing, strange = (replace_data(good[0], data) for data in (None, b"", b"\x00" * 99))
    matcher.give(VIEWS, good[0], *views(2, source="cm2dp"), damaged, nothing, strange)
    matcher.give(VIEWS, *good[1:], *views(3, first=3))
    assert ids(matcher) == [0, 1, 2, 0, 1, 2]
    assert len(causes(caplog)) == 3
    assert sorted(matcher.problems().values()) == [1, 2, 2]


def test_views_without_stamps_are_refused_or_dated_by_their_arrival(
    caplog: pytest.LogCaptureFixture,
) -> None:
    from fusionslam.ros.messages.library import ros_time

    refusing, dating = Desk("lv_matching"), Desk("lv_matching", node={"stamps": "arrival"})
    dating.now_ns = 7 * S
    for message in views(2):
        message.header.stamp = ros_time(0)
        refusing.give(VIEWS, message)
        dating.give(VIEWS, message)
    assert not ids(refusing) and list(refusing.problems().values()) == [2]
    assert causes(caplog) == ["no-stamp"]
    assert [message.header.stamp.to_nsec() for message in dating.outlet.of(IDS)] == [7 * S] * 2


def replace_data(message: Any, data: bytes | None) -> Any:
    """A copy with other bytes; None cuts its own short."""
    from copy import copy

    found = copy(message)
    found.data = message.data[:-7] if data is None else data
    return found


def picture(k: int) -> Picture:
    image = np.random.default_rng(k % 3).integers(0, 256, (160, 200, 3), dtype=np.uint8)
    return Picture(stamp_ns=S * (k + 1), frame_id="camera", image=image)


def test_images_that_do_not_decode_or_are_too_small(caplog: pytest.LogCaptureFixture) -> None:
    from fusionslam.ros.messages.library import build

    matcher, cut = Desk("lv_matching", source="visual_templates"), build(picture(1), "jpeg")
    cut.data = cut.data[:200]
    tiny = replace(picture(1), image=picture(1).image[:20, :20])
    matcher.give(IMAGES, picture(0), cut, cut, tiny, tiny, picture(1), picture(3))
    assert ids(matcher) == [0, 1, 0]
    assert len(causes(caplog)) == 2
    assert sorted(matcher.problems().values()) == [2, 2]


def test_a_bag_that_is_played_again_is_recognised() -> None:
    matcher, loops = Desk("lv_matching"), Desk("loop_closure", loop_closure={"window": 0})
    for _ in range(2):
        matcher.give(VIEWS, *views(3))
        loops.give(CLOUDS, *map(cloud, range(3)))
    assert ids(matcher) == [0, 1, 2, 0, 1, 2]
    found = loops.outlet.of(LOOPS)[-3:]
    assert [(loop.query, loop.match) for loop in found] == [(3, 0), (4, 1), (5, 2)]
    assert not matcher.problems() and not loops.problems()


MAKERS: dict[str, tuple[str, str, Callable[[int], list[Any]]]] = {
    "lv_matching": ("lv_matching", VIEWS, lambda first: views(3, first)),
    "images": ("lv_matching", IMAGES, lambda first: [picture(first + k) for k in range(3)]),
    "loop_closure": ("loop_closure", CLOUDS, lambda first: [cloud(first + k) for k in range(3)]),
}


class Remembering:
    """A node with a memory, and what it is given."""

    def __init__(self, kind: str, path: Path, **parameters: Any) -> None:
        self.name, self.topic, self.made = MAKERS[kind]
        source = {"source": "visual_templates"} if kind == "images" else {}
        self.known = {
            **source,
            **parameters,
            "memory": {"file": str(path / "memory"), "every": 1e-9},
        }
        if self.name == "loop_closure":
            self.known.setdefault("loop_closure", {"window": 0})

    def started(self, **more: Any) -> Desk:
        return Desk(self.name, **{**self.known, **more})

    def closed(self) -> "Remembering":
        """After a first run with three messages."""
        desk = self.started()
        desk.give(self.topic, *self.made(0))
        desk.node.close()
        return self


def answers(desk: Desk) -> list[tuple[int, ...]]:
    found: list[tuple[int, ...]] = [(loop.query, loop.match) for loop in desk.outlet.of(LOOPS)]
    return found or [(number,) for number in ids(desk)]


@rows("kind, closed", product(MAKERS, [True, False]))
def test_a_node_goes_on_where_it_ended_or_was_killed(
    kind: str, closed: bool, tmp_path: Path
) -> None:
    whole = Remembering(kind, tmp_path / "never")
    desk = whole.started()
    desk.give(whole.topic, *whole.made(0), *whole.made(3))
    each = Remembering(kind, tmp_path / "kept")
    first = each.started()
    first.give(each.topic, *each.made(0))
    if closed:
        first.node.close()
    second = each.started()
    second.give(each.topic, *each.made(3))
    assert answers(desk)[-3:] == answers(second)[-3:]


@rows("kind", MAKERS)
def test_a_full_disk_leaves_the_last_whole_file_and_loses_no_memory(
    kind: str, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    each = Remembering(kind, tmp_path)
    desk = each.started()
    desk.give(each.topic, *each.made(0))
    before = answers(each.started())
    with limited_files(100):
        desk.give(each.topic, *each.made(3))
        desk.give(each.topic, *each.made(6))
        desk.node.close()
    assert causes(caplog) == ["cannot-write", "lost"]
    assert answers(each.started()) == before
    desk.node.close()
    last = each.started()
    for going in (desk, last):
        going.give(each.topic, *each.made(9))
    assert answers(last)[-3:] == answers(desk)[-3:] and len(answers(desk)) > 6


@rows("kind", MAKERS)
def test_a_damaged_memory_is_refused_at_the_start_with_what_to_do(
    kind: str, tmp_path: Path
) -> None:
    each = Remembering(kind, tmp_path).closed()
    path = tmp_path / "memory"
    for file in path.iterdir() if path.is_dir() else [path]:
        file.write_bytes(file.read_bytes()[:30])
    with pytest.raises(DataError, match="~memory/file") as error:
        each.started()
    assert error.value.code == "bad-state" and "\n" not in str(error.value)
    shutil.rmtree(path) if path.is_dir() else path.unlink()
    each.started()


@rows(
    "kind, other, name",
    [
        ("lv_matching", {"views": {"threshold": 0.5}}, "views"),
        ("lv_matching", {"descriptors": {"preset": "paper"}}, "descriptors"),
        ("images", {"visual_templates": {"threshold": 0.5}}, "visual_templates"),
        ("loop_closure", {"descriptor": "m2dp"}, "descriptor"),
        ("loop_closure", {"loop_closure": {"window": 5}}, "loop_closure"),
        ("loop_closure", {"descriptors": {"preset": "paper"}}, "descriptors"),
    ],
)
def test_a_memory_of_other_parameters_is_refused(
    kind: str, other: dict[str, Any], name: str, tmp_path: Path
) -> None:
    each = Remembering(kind, tmp_path).closed()
    with refuses("other-settings", f"~{name}", error=ConfigError):
        each.started(**other)


def test_the_threshold_and_the_bound_of_loops_may_change_at_a_start(tmp_path: Path) -> None:
    each = Remembering("loop_closure", tmp_path)
    plain = {"window": 0, "verify": False}
    desk = each.started(loop_closure=plain)
    desk.give(each.topic, *each.made(0))
    desk.node.close()
    again = each.started(loop_closure=plain | {"threshold": 0.75, "max_frames": 7})
    detector = again.node._loops
    assert (detector.threshold, detector.config.max_frames, len(detector)) == (0.75, 7, 3)


@rows("node", ["lv_matching", "loop_closure", "ratslam"])
def test_a_file_that_is_no_memory_is_refused_with_what_to_do(node: str, tmp_path: Path) -> None:
    (tmp_path / "photo.jpg").write_bytes(b"no memory")
    with pytest.raises(DataError, match=r"photo\.jpg", check=has_code("bad-state")):
        Desk(node, memory={"file": str(tmp_path / "photo.jpg")})
    assert (tmp_path / "photo.jpg").read_bytes() == b"no memory"


def test_an_empty_folder_is_a_memory_of_nothing(tmp_path: Path) -> None:
    (tmp_path / "memory").mkdir()
    assert not Remembering("loop_closure", tmp_path).started().problems()
