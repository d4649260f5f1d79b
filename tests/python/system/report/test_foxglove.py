# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The live view of Foxglove, read by a viewer of its protocol."""

import io
import logging
import os
import socket
import subprocess
import sys
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from circling_robot import MS, START, circle
from error_codes import has_code
from foxglove_client import Viewer, cloud_of
from fusionslam import ConfigError, DataError
from fusionslam.ratslam import Motion, RatSlam
from fusionslam.ratslam.events import Look
from fusionslam.ratslam.slam import Step
from fusionslam.ratslam.view_sources import TemplateSource
from fusionslam.sensors.frame import Cloud
from fusionslam.sensors.messages import FrameTransform, FrameTransforms, Picture, Scan
from rows import rows

pytest.importorskip("foxglove", reason="foxglove-sdk is not installed")
from fusionslam.report.live import foxglove_messages as make
from fusionslam.report.live import foxglove_server
from fusionslam.report.live.foxglove_server import FoxgloveServer
from fusionslam.report.live.foxglove_view import FoxgloveView

TOPICS = {"cloud": "PointCloud", "image": "CompressedImage", "views": ("id", "node")}


def colored_scan(count: int = 60_000, stamp_ns: int = START) -> Scan:
    rng = np.random.default_rng(1)
    points = rng.normal(0, 20, (count, 3)).astype(np.float32)
    colors = rng.integers(0, 256, (count, 3), np.uint8)
    return Scan(stamp_ns=stamp_ns, frame_id="/robot", points=points, colors=colors)


def serve(**more: Any) -> FoxgloveServer:
    return FoxgloveServer(TOPICS, port=0, **more)


def listening(port: int) -> set[str]:
    """Hexadecimal addresses on which somebody listens at a port, of IPv4 and IPv6."""
    rows = [
        line.split()
        for name in ("tcp", "tcp6")
        for line in Path(f"/proc/self/net/{name}").read_text().splitlines()[1:]
    ]
    found = (row[1].split(":") for row in rows if row[3] == "0A")
    return {address for address, at in found if int(at, 16) == port}


def port_of_this_process() -> int:
    """A free port below those that systems give to whoever asks for any, unlike one of these.

    A port that was given so and closed may belong to another test of this machine by now.
    """
    for port in range(20_000 + os.getpid() % 10_000, 32_000):
        with suppress(OSError), socket.create_server(("127.0.0.1", port)):
            return port
    raise RuntimeError("no port is free")


def test_points_and_colours_arrive_as_they_were_sent_or_grey() -> None:
    scan = colored_scan()
    with serve() as server, Viewer(server.url) as viewer:
        assert viewer.name == "fusionslam" and not server.is_wanted("cloud")
        server.show("cloud", scan.stamp_ns, make.cloud_message(scan))
        viewer.subscribe("cloud")
        topic, time_ns, message = viewer.receive()
        points, colors = cloud_of(message)
        assert (topic, time_ns, message.frame_id) == ("cloud", START, "robot")
        assert message.timestamp.ToNanoseconds() == START and server.is_wanted("cloud")
    assert np.array_equal(points, scan.points) and np.array_equal(colors, scan.colors)
    with serve() as server, Viewer(server.url) as viewer:
        grey = replace(colored_scan(10), colors=None)
        server.show("cloud", grey.stamp_ns, make.cloud_message(grey))
        viewer.subscribe("cloud")
        _, colors = cloud_of(viewer.receive()[2])
    assert len(colors) == 10 and (colors == colors[0, 0]).all()


def test_images_and_numbers_arrive() -> None:
    image = np.full((48, 64, 3), (200, 100, 50), np.uint8)
    picture = Picture(stamp_ns=START, frame_id="camera", image=image)
    with serve() as server, Viewer(server.url) as viewer:
        server.show("image", START, make.image_message(picture))
        server.show("views", START, {"id": 3, "node": 7})
        viewer.subscribe("image", "views")
        found = dict([viewer.receive()[::2], viewer.receive()[::2]])
    assert found["views"] == {"id": 3, "node": 7}
    read = np.asarray(Image.open(io.BytesIO(found["image"].data)))
    assert read.shape == image.shape and abs(read.astype(int) - image).max() <= 3


def test_a_viewer_gets_the_last_message_and_then_the_next_ones() -> None:
    with serve() as server, Viewer(server.url) as one, Viewer(server.url) as two:
        server.show("views", START, {"id": 0})
        server.show("views", START, {"id": 1})
        for viewer in (one, two):
            viewer.subscribe("views")
            assert viewer.receive()[2] == {"id": 1}
        server.show("views", START + 1, {"id": 2})
        assert two.receive()[2] == {"id": 2}
        # The other one, which saw it before, got the last message with the second once more.
        assert [one.receive()[2]["id"] for _ in range(2)] == [1, 2]
        server.show("views", START + 2, {"id": 3})
        assert one.receive()[2] == {"id": 3}


def test_a_viewer_slower_than_a_recording_misses_messages_but_not_the_newest() -> None:
    with serve() as server, Viewer(server.url) as viewer:
        viewer.follow(server, "views")
        for k in range(20_000):
            server.show("views", k * 1000 * MS, {"id": k})
        last = {"id": -1}
        while last["id"] < 19_999:
            last = viewer.receive()[2]


def test_transforms_keep_their_poses() -> None:
    pose = np.eye(4)
    pose[:3, :3] = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
    pose[:3, 3] = (1, 2, 3)
    link = FrameTransform(stamp_ns=START, parent="/map", child="/odom", parent_from_child=pose)
    message = make.transforms_message(FrameTransforms(transforms=(link,)))
    with FoxgloveServer({"tf": "FrameTransforms"}, port=0) as server, Viewer(server.url) as viewer:
        server.show("tf", START, message)
        viewer.subscribe("tf")
        (found,) = viewer.receive()[2].transforms
    turn, move = found.rotation, found.translation
    assert (found.parent_frame_id, found.child_frame_id) == ("map", "odom")
    assert (turn.x, turn.y, turn.z, turn.w) == pytest.approx((0, 0, 0.5**0.5, 0.5**0.5))
    assert (move.x, move.y, move.z) == (1, 2, 3)


def test_others_reach_it_with_a_warning_only(caplog: pytest.LogCaptureFixture) -> None:
    with serve() as server:
        assert server.url == f"ws://127.0.0.1:{server.port}"
        assert listening(server.port) == {"0100007F"}
    assert not [each for each in caplog.records if each.name.startswith("fusionslam")]
    with serve(host="0.0.0.0") as server:
        assert listening(server.port) == {"00000000"}
    (record,) = [each for each in caplog.records if each.name.startswith("fusionslam")]
    assert record.levelno == logging.WARNING and record.args[:2] == ("0.0.0.0", server.port)


def test_a_port_in_use_is_named_and_free_again_after_closing() -> None:
    first = FoxgloveServer(TOPICS, port=port_of_this_process())
    with Viewer(first.url):
        in_use = has_code("port-in-use", "127.0.0.1", first.port)
        with pytest.raises(ConfigError, match=str(first.port), check=in_use):
            FoxgloveServer(TOPICS, port=first.port)
        first.close()
        first.close()
    with FoxgloveServer(TOPICS, port=first.port) as second:
        assert second.port == first.port


HOSTS = [("no.such.host.invalid", 0), ("192.0.2.1", 0), ("127.0.0.1", 70000)]


@rows("host, port", HOSTS)
def test_hosts_and_ports_that_cannot_be_had_are_named(host: str, port: int) -> None:
    code = "no-port" if port else "no-host"
    with pytest.raises(ConfigError, check=has_code(code, host, str(port))):
        FoxgloveServer(TOPICS, host, port)


def test_a_stranger_on_the_port_disturbs_nobody() -> None:
    with serve() as server, Viewer(server.url) as viewer:
        with socket.create_connection(("127.0.0.1", server.port)) as line:
            line.sendall(b"GET / HTTP/1.1\r\n\r\n")
            line.recv(100)
        viewer.subscribe("views")
        server.show("views", START, {"id": 1})
        assert viewer.receive()[2] == {"id": 1}


def drive(view: FoxgloveView, slam: RatSlam) -> list[Step]:
    steps = []
    for event in circle():
        steps.append(slam.step(event))
        view.step(steps[-1], slam, event)
    return steps


def test_a_run_shows_its_map_robot_and_numbers(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(foxglove_server, "_WAITING", 1000)  # more than the run shows
    slam, found = RatSlam(), dict[str, list[Any]]()
    with FoxgloveView(port=0, name="circle") as view, Viewer(view.url) as viewer:
        assert viewer.name == "circle"
        viewer.follow(view._server, *viewer.channels)
        steps = drive(view, slam)
        monkeypatch.setattr(view, "_end", lambda: found.update(viewer.receive_shown()))
        view.close()
        view._server.close()
    nodes = {each.id: each for each in found["map"][-1].entities}
    places = [(d.pose.position.x, d.pose.position.y) for d in nodes["nodes"].spheres]
    np.testing.assert_allclose(places, slam.map.nodes[:, :2])
    ends = np.reshape(nodes["links"].lines[0].indices, (-1, 2))
    links = slam.map.links
    assert np.array_equal(ends, np.stack([links["source"], links["target"]], axis=1))
    edges = [each.action for each in steps if int(each.action.kind) == 2]
    loops = np.reshape(nodes["loops"].lines[0].indices, (-1, 2)).tolist()
    assert loops == [[each.source, each.target] for each in edges] and loops
    assert found["size"][-1]["nodes"] == len(slam.map.nodes)
    looks = [step for step in steps if step.looked]
    assert [each["id"] for each in found["views"]] == [step.view_id for step in looks]
    assert [each.message for each in found["log"]] == [step.why for step in steps if step.why]
    last = {each.child_frame_id: each.translation for each in found["tf"][-1].transforms}
    assert set(last) == {"robot", "dead_reckoning"}
    path = found["way/live"][-1].poses
    assert len(path) > 20 and path[0].orientation.w == 1.0


def test_what_was_looked_at_is_shown_to_those_who_look() -> None:
    scan = colored_scan(50)
    slam, image = RatSlam(views=TemplateSource()), np.full((480, 640, 3), 90, np.uint8)
    step = slam.step(Look(START, image))
    with FoxgloveView(port=0) as view, Viewer(view.url) as viewer:
        viewer.follow(view._server, "image", "cloud")
        view.step(step, slam, Look(START, image))
        later = replace(step, stamp_ns=START + 300 * MS)
        view.step(later, slam, Look(later.stamp_ns, Cloud(scan.points, scan.colors)))
        found = [viewer.receive() for _ in range(2)]
    assert [each[:2] for each in found] == [("image", START), ("cloud", later.stamp_ns)]
    assert np.array_equal(cloud_of(found[1][2])[0], scan.points)


def test_a_closed_view_shows_no_more() -> None:
    slam, view = RatSlam(), FoxgloveView(port=0)
    view.close()
    with pytest.raises(DataError, check=has_code("closed")):
        view.step(slam.step(Motion(START, 0.5, 0.0)), slam)


WITHOUT = """
import sys
sys.modules["foxglove"] = None
from fusionslam import FusionSlamError
try:
    from fusionslam.report.live.foxglove_view import FoxgloveView
except FusionSlamError as error:
    print(error.code, *error.fields)
"""


def test_without_the_sdk_the_extra_is_named() -> None:
    result = subprocess.run([sys.executable, "-c", WITHOUT], capture_output=True, text=True)
    assert result.stdout.split() == ["missing-extra", "live"], result.stderr
