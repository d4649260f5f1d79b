# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What fuse writes where, and that it never writes over what it reads."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bags import SECOND, START, drive, odometry, translation, without, write_bag
from cli import error_of, succeeds
from fusionslam import FusionConfig
from fusionslam.datasets import open_dataset
from fusionslam.datasets.bags import open_bag
from fusionslam.geometry.se3 import exp
from fusionslam.pipelines.export_bag import write_cloud_bag
from fusionslam.pipelines.export_folder import write_clouds
from fusionslam.pipelines.recording import Recording
from fusionslam.report.fusion_stages import draw_stages
from fusionslam.sensors.messages import Event, FrameTransforms, Odometry, Scan
from kitti import write_sequence
from refusals import refuses
from rows import rows

pytest.importorskip("rosbags")


def contents(path: Path) -> dict[str, bytes]:
    files = [path] if path.is_file() else sorted(p for p in path.rglob("*") if p.is_file())
    return {str(file): file.read_bytes() for file in files}


def with_truth(offset: float = 0.0, until: int = 0) -> list[Event]:
    """A drive with the truth beside odometry; the two differ from frame ``until`` on."""
    events = []
    for event in drive():
        events.append(event)
        if isinstance(event.message, Odometry):
            given = odometry(event.message.stamp_ns)
            wrong = offset if event.message.stamp_ns >= drive()[0].time_ns + until else 0.0
            truth = Odometry(
                stamp_ns=given.stamp_ns,
                frame_id="map",
                child_frame_id="base",
                pose=given.pose @ translation(0, wrong),
            )
            events.append(Event("/ground_truth", event.time_ns, truth))
    return events


@rows("suffix", ["bag", "mcap", "db3"])
def test_a_bag_is_never_written_over_itself(tmp_path: Path, suffix: str) -> None:
    path = write_bag(tmp_path / f"drive.{suffix}", drive())
    before = contents(path)
    assert error_of(1, "fuse", path, "-o", path).code == "output-is-input"
    link = tmp_path / f"link.{suffix}"
    link.symlink_to(path)
    assert error_of(1, "fuse", path, "-o", link).code == "output-is-input"
    assert contents(path) == before


def test_neither_a_bag_that_holds_the_file_nor_its_rest_is_written_over(tmp_path: Path) -> None:
    folder = write_bag(tmp_path / "drive.db3", drive())
    (inner,) = folder.glob("*.db3")
    before = contents(folder)
    for read, written in ((inner, folder), (folder, inner)):
        with refuses("output-is-input"):
            write_cloud_bag(Recording.at(read), written, FusionConfig())
    assert contents(folder) == before
    rest = write_bag(tmp_path / "drive.partial.bag", drive())
    with refuses("output-is-input"):
        write_cloud_bag(Recording.at(rest), tmp_path / "drive.bag", FusionConfig())


def test_a_folder_is_never_written_over_itself_and_its_colours_warn_nobody(tmp_path: Path) -> None:
    made = tmp_path / "made"
    write_clouds(Recording.at(write_bag(tmp_path / "d.bag", drive())), made, FusionConfig())
    before = contents(made)
    assert error_of(1, "fuse", made, "-o", made).code == "output-is-input"
    assert contents(made) == before
    assert "no colours" not in said_by_fuse(made, "-o", tmp_path / "again")


def test_what_is_written_is_counted_and_a_bag_that_is_replaced_is_named(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "d.bag", drive())
    for name, there in (("made", 0), ("made.bag", 0), ("made", 0), ("made.bag", 1)):
        result = succeeds("fuse", path, "-o", tmp_path / name)
        assert result.stdout.splitlines() == [f"{tmp_path / name}: 5 frames"]
        assert " ".join(result.stderr.split()).count("will be replaced") == there


TURNED = "a median of 4.0 degrees and up to 4.0"


@rows(
    "command, output, turn_deg, said",
    [
        ("fuse --no-deskew", "made", 40.0, TURNED),
        ("fuse --no-deskew", "made.bag", 40.0, TURNED),
        ("loops -d m2dp,scan_context --no-deskew", "made", 40.0, TURNED),
        ("loops --threshold 0.1 --no-deskew", "made", 40.0, TURNED),
        ("fuse --no-deskew", "made", 0.0, ""),
        ("fuse", "made", 40.0, ""),
    ],
)
def test_turns_within_scans_that_are_not_undone_are_said(
    tmp_path: Path, command: str, output: str, turn_deg: float, said: str
) -> None:
    """Scans of 0.1 s; the robot turns by some degrees a second."""

    def turning(event: Event) -> Event:
        message = event.message
        if isinstance(message, Scan):
            fields = {**message.fields, "time": np.linspace(0, 0.1, 41, dtype=np.float32)}
            points = np.random.default_rng(0).uniform(1, 4, (41, 3)).astype(np.float32)
            return replace(event, message=replace(message, points=points, fields=fields))
        if isinstance(message, Odometry):
            angle = np.radians(turn_deg) * (message.stamp_ns - START) / SECOND
            return replace(
                event, message=replace(message, pose=exp(np.array([0, 0, 0, 0, 0, angle])))
            )
        return event

    path = write_bag(tmp_path / "d.bag", map(turning, drive(1.0)))
    made = succeeds(*command.split(), path, "-o", tmp_path / output, "--source", "cloud")
    text = " ".join(made.stderr.split())
    assert text.count("turned within them") == bool(said)
    assert said in text


def test_clouds_and_times_that_no_fuse_wrote_are_kept(tmp_path: Path) -> None:
    base = tmp_path / "kitti"
    data = write_sequence(base, [0, 2, 5], [300] * 3, metres=1.5, width=64)
    before = contents(data)
    error = error_of(1, "fuse", base, "-o", data, "--sequence", data.name)
    assert error.code == "other-results" and error.fields == (str(data), "times.txt")
    assert contents(data) == before


def truths(path: Path) -> list[Odometry]:
    with open_bag(path) as bag:
        return [event.message for event in bag.events() if event.topic == "/ground_truth"]


def test_every_frame_has_its_truth_where_odometry_is_right_too(tmp_path: Path) -> None:
    """Odometry is right in the first three of five frames, then 0.4 m beside the truth."""
    for name, offset in (("later", 0.4), ("never", 0.0)):
        events = with_truth(offset, until=1_500_000_000)
        read = Recording.at(write_bag(tmp_path / f"{name}.bag", events))
        write_cloud_bag(read, tmp_path / "made.bag", FusionConfig())
        found = truths(tmp_path / "made.bag")
        sideways = [message.pose[1, 3] for message in found]
        assert sideways == pytest.approx([0, 0, 0, offset, offset])
        poses = open_dataset(tmp_path / "made.bag").poses
        assert poses is not None and poses[:, 1, 3] == pytest.approx(sideways)


@rows("camera_is_fixed", [True, False])
def test_links_that_do_not_move_are_static(tmp_path: Path, camera_is_fixed: bool) -> None:
    """An image that is lost makes the camera's place against the scan that of another time."""
    events = drive()
    if not camera_is_fixed:
        lost = events[0].time_ns + 1_000_000_000
        events = [e for e in events if (e.topic, e.time_ns) != ("/camera/image", lost)]
    made = tmp_path / "made.bag"
    write_cloud_bag(Recording.at(write_bag(tmp_path / "d.bag", events)), made, FusionConfig())
    links: dict[str, list[str]] = {"/tf": [], "/tf_static": []}
    with open_bag(made) as bag:
        for event in bag.events():
            if isinstance(event.message, FrameTransforms):
                links[event.topic] += [link.child for link in event.message.transforms]
    moving = ["base_footprint"] if camera_is_fixed else ["base_footprint", "camera"]
    fixed = ["lidar", "camera"] if camera_is_fixed else ["lidar"]
    assert links == {"/tf": moving * 5, "/tf_static": fixed}
    assert truths(made) == []  # odometry alone is no truth
    made_set, given = open_dataset(made), open_dataset(tmp_path / "d.bag")
    assert np.allclose(made_set[3].robot_from_points, given[3].robot_from_points)


def said_by_fuse(*arguments: object) -> str:
    """Its messages, without their line breaks."""
    return " ".join(succeeds("fuse", *arguments).stderr.split())


@rows("lacking", ["/camera/image", "/camera/camera_info"])
def test_clouds_that_stay_without_colours_are_announced(tmp_path: Path, lacking: str) -> None:
    path = write_bag(tmp_path / "d.bag", without(drive(), lacking))
    warning = "clouds have no colours (source cloud)"
    assert warning in said_by_fuse(path, "-o", tmp_path / "one")
    # Somebody who asks for it knows.
    assert warning not in said_by_fuse(path, "-o", tmp_path / "two", "--source", "cloud")


def test_titles_of_pictures_name_what_is_drawn(tmp_path: Path) -> None:
    def titles(frame: object, **config: object) -> list[str]:
        figure = draw_stages(frame, FusionConfig(**config))
        return [axis.get_title(loc="left") for axis in figure.axes]

    bag = open_dataset(write_bag(tmp_path / "d.bag", drive()), sensors=("points",))
    assert titles(bag[0], source="cloud")[1:3] == [
        "scan, 41 points, colour is height",
        "cloud without colours, 41 points",
    ]
    data = write_sequence(tmp_path / "k", [0], [300], metres=1.5, width=160)
    pair = open_dataset(data, sensors=("left", "right"))
    assert titles(pair[0], source="stereo")[1].startswith("cloud (stereo), ")
