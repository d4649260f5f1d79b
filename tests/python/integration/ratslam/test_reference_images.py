# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Maps made of images: the reference's run end to end, and a camera that turns on the spot."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from fusionslam.errors import DataError
from fusionslam.geometry.trajectory import Trajectory
from fusionslam.pipelines.drive_images import (
    estimate_motions,
    image_stamps_ns,
    visual_motions,
    visual_speeds,
)
from fusionslam.pipelines.drives import Drive, open_drive
from fusionslam.pipelines.map_events import events_of
from fusionslam.ratslam import Look, Motion, RatSlam, TemplateSource
from fusionslam.ratslam.visual_odometry import VisualOdometry, VisualOdometryConfig
from fusionslam.sensors.image_series import ImageSeries
from maps import reference_table
from rows import rows
from worlds import VIEW, room_image

TENTH = 100_000_000
# The room's images have 24 rows.
ROOM_TEMPLATES = {"rows": 4, "bottom": None}


@pytest.mark.nightly
def test_the_reference_run_out_of_images_gives_its_actions_and_its_map(test_data: Path) -> None:
    folder = test_data / "reference" / "ratslam"
    rows, expected = (reference_table(folder / f"pc_{each}.csv.gz") for each in ("input", "output"))
    # Two noisy images of each of 180 places that look different.
    first_lap = np.load(folder / "lv_images.npz")["images"][:120].reshape(60, 2, 240, 416)
    pictures = np.concatenate([first_lap, first_lap[:, :, ::-1], first_lap[:, :, :, ::-1]])
    slam = RatSlam(
        preset="openratslam",
        map={"initial_heading": float(np.radians(140))},
        views=TemplateSource(),
    )
    slam.step(Motion(0, 0.0, 0.0))
    maker = TemplateSource().templates
    kept = [[maker.view(image) for image in pair] for pair in pictures[:136]]
    for step, row in enumerate(rows):
        now = (step + 1) * TENTH
        seen = slam.step(Look(now, kept[int(row["vt_id"])][step % 2]))
        assert seen.view_id == row["vt_id"]
        done = slam.step(Motion(now, row["vtrans"], row["vrot"]))
        wanted = expected[step]
        assert done.action.kind == wanted["action"]
        if done.action.kind:
            assert done.action[1:3] == (wanted["src_exp"], wanted["dest_exp"])
    wanted = json.loads((folder / "em_output.json").read_text())["nodes"]
    places = np.array([[node[name] for name in ("x", "y", "th")] for node in wanted])
    np.testing.assert_allclose(slam.map.nodes, places, rtol=0, atol=1e-9)
    assert len(slam.map.links) == 136


def test_the_references_images_give_its_templates_and_a_map_with_loops(test_data: Path) -> None:
    folder = test_data / "reference" / "ratslam"
    images = np.load(folder / "lv_images.npz")["images"]
    ids = np.loadtxt(folder / "lv_output.csv", delimiter=",", skiprows=1)[:, 1]
    slam = RatSlam(preset="openratslam", views=TemplateSource())
    slam.step(Motion(0, 0.0, 0.0))
    for frame, image in enumerate(images):
        now = (frame + 1) * TENTH
        assert slam.step(Look(now, image)).view_id == ids[frame]
        # Sixty places on a circle: 0.3 m, and a sixtieth of a turn, between two of them.
        moved = frame and frame % 2 == 0
        slam.step(Motion(now, 3.0 * moved, 20 * np.pi / 60 * moved))
    seen_again = ids[120:]
    assert slam.memory.node_views == [*range(62)]
    loops = {(link["source"], link["target"]) for link in slam.map.links}
    assert any(target < source for source, target in loops)
    # Back at the start after one lap: the node of the view, not a new one for each of them.
    assert slam.map.current == seen_again[-1] == 11


class PaintedRoom(Drive):
    """A robot that turns on the spot in a painted room, seen by its camera only."""

    name = "painted room"

    def __init__(self, yaw: Callable[[NDArray[Any]], NDArray[Any]], seconds: float) -> None:
        times = np.arange(round(seconds * 10) + 1) / 10
        self._yaw, self._times = yaw(times), times
        self.stamps_ns = np.round(times[::5] * 1e9).astype(np.int64)
        self.truth = Trajectory(times, 0 * times, 0 * times, self._yaw)

    def scan(self, index: int, *, ground: bool) -> None:
        raise DataError("there is no scanner")

    def images(self, bottom: int | None = None) -> ImageSeries:
        return ImageSeries(self._times, None, lambda n: room_image(yaw=self._yaw[n]), "painted")


@rows("preset", ["robust", "openratslam"])
def test_a_camera_alone_maps_turns_on_the_spot(preset: str) -> None:
    turns = 1.5
    drive = PaintedRoom(lambda seconds: 2 * np.pi * turns / 12 * seconds, seconds=12)
    source = TemplateSource(**ROOM_TEMPLATES)
    seen = VisualOdometryConfig(preset=preset, field_of_view=VIEW)
    events = events_of(drive, source, "visual", seen=seen)
    assert events.odometry == f"visual odometry ({preset})"
    slam = RatSlam(preset="openratslam", views=source)
    nodes, facing = [], []
    for event in events:
        step = slam.step(event)
        nodes.append(len(slam.map.nodes))
        facing.append(step.dead_reckoning[2])
    turned = np.unwrap(facing)[-1] - facing[0]
    assert turned == pytest.approx(2 * np.pi * turns, rel=0.006 if preset == "robust" else 0.05)
    # Eighty images a round: each is a node in the first one, and later rounds come back to them.
    assert nodes[len(nodes) * 3 // 4] == 80 and nodes[-1] <= 81
    assert any(link["target"] < link["source"] for link in slam.map.links)


@pytest.mark.nightly
def test_the_images_of_a_bag_give_its_motion(test_data: Path) -> None:
    drive = open_drive(test_data / "bags" / "small_house_20s.bag")
    source = TemplateSource()
    seen = events_of(drive, source, "visual", jobs=2)
    assert [motion.stamp_ns for motion in seen.motions] == seen.look_stamps_ns.tolist()
    again = events_of(drive, source, "visual", seen=VisualOdometryConfig(distance_m=8.0))
    slow, fast = (np.array([(m.v, m.w) for m in one.motions]) for one in (seen, again))
    free = np.abs(fast[:, 0]) < 1
    np.testing.assert_allclose(fast[free, 0], 2 * slow[free, 0])
    np.testing.assert_array_equal(fast[:, 1], slow[:, 1])
    wheels = [
        (m.stamp_ns / 1e9, m.pose[0, 3], m.pose[1, 3], np.arctan2(m.pose[1, 0], m.pose[0, 0]))
        for m in events_of(drive, source, "topic").motions
    ]
    seconds, x, y, yaw = np.array(wheels).T
    times = seen.look_stamps_ns / 1e9
    turn_rates = np.diff(np.interp(times, seconds, np.unwrap(yaw))) / np.diff(times)
    driven = np.cumsum(np.hypot(np.diff(x, prepend=x[0]), np.diff(y, prepend=y[0])))
    way = np.interp(times[[0, -1]], seconds, driven)
    assert np.abs(turn_rates - slow[1:, 1]).mean() < 0.02 < np.abs(turn_rates).mean() / 5
    assert (slow[1:, 0] * np.diff(times)).sum() == pytest.approx(way[1] - way[0], rel=0.1)


def test_a_drive_without_images_has_no_visual_odometry() -> None:
    drive = PaintedRoom(lambda seconds: seconds, seconds=2)
    drive.images = lambda bottom=None: None  # type: ignore
    with pytest.raises(DataError, match="painted room"):
        estimate_motions(drive)


def test_images_that_give_no_speed_stand_still_and_are_logged(
    caplog: pytest.LogCaptureFixture,
) -> None:
    blank = np.full((24, 320), 9, np.uint8)
    pictures = [room_image(yaw=0.05), room_image(yaw=0.1), blank, room_image(yaw=0.15)]
    images = ImageSeries(np.array([0.0, 0.1, 0.2, 2.0]), None, pictures.__getitem__, "made")
    speeds = visual_speeds(images, VisualOdometry())
    motions = visual_motions(image_stamps_ns(images), speeds)
    assert [bool(motion.w) for motion in motions] == [False, True, False, False]
    assert "1 of 4 images" in caplog.text and "1.80 s" in caplog.text


def test_profiles_of_rendered_images_are_cached_and_a_damaged_cache_is_replaced(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("FUSIONSLAM_CACHE", str(tmp_path))
    asked: list[int] = []

    def render(index: int) -> NDArray[np.uint8]:
        asked.append(index)
        return room_image(yaw=0.04 * index)

    images = ImageSeries(np.arange(5) / 10, None, render, "rendered", key="a room")
    first = visual_speeds(images, VisualOdometry(), jobs=2)
    assert visual_speeds(images, VisualOdometry()) == first and sorted(asked) == [*range(5)]
    assert visual_speeds(images, VisualOdometry(distance_m=2.0)) != first and len(asked) == 5
    visual_speeds(images, VisualOdometry(turn_rows=(0.0, 0.3)))
    assert len(asked) == 10
    for path in tmp_path.iterdir():
        path.write_bytes(path.read_bytes()[:100])
    assert visual_speeds(images, VisualOdometry()) == first and len(asked) == 15
