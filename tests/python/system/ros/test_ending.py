# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""How live nodes start and end: names, parameters, places that cannot be written, Ctrl-C."""

import signal
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import pytest

from benchmarks.ros.world import PATIENCE_S, ROOT
from fusionslam.errors import ConfigError
from ros_master import RosWorld, needs_ros, wait_until
from rows import rows

pytestmark = needs_ros

VIEWS = "current_scene_description"


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RosWorld]:
    with RosWorld(tmp_path_factory.mktemp("world")) as started:
        yield started


def master_of(world: RosWorld) -> Any:
    import rosgraph

    return rosgraph.Master("/test", world.environment["ROS_MASTER_URI"])


def state_of(world: RosWorld) -> tuple[set[str], set[str]]:
    """Topics that are published and listened to."""
    published, heard, _ = master_of(world).getSystemState()
    return {topic for topic, _ in published}, {topic for topic, _ in heard}


@pytest.mark.nightly
@rows(
    "name, argument, parameter",
    [
        ("data_fusion", "_online/wiat:=1", "~online/wiat"),
        ("lv_builder", "_source:=alignmnt", "~source"),
        ("loop_closure", "_memory/file:={folder}", "~memory/file"),
        ("mapper", "_map/session:=monday", "~map/file"),
    ],
)
def test_a_parameter_that_a_node_cannot_start_with_is_named_in_one_line(
    name: str, argument: str, parameter: str, world: RosWorld
) -> None:
    folder = world.folder / "no_memory"
    folder.mkdir(exist_ok=True)
    (folder / "detector.json").write_text("{")
    names = (f"__name:=wrong_{name}", argument.format(folder=folder))
    process = world.node(name, *names, ready=False)
    assert process.wait(timeout=PATIENCE_S) == 2
    (line,) = world.log(name).splitlines()
    assert line.startswith(f"error: {name}: ") and parameter in line
    # A wrong parameter does not stay for the next start.
    if "memory" not in argument:
        assert master_of(world).getParam(f"/wrong_{name}") == {}


def without_logs(folder: str) -> list[str]:
    node = str(ROOT / "ros" / "nodes" / "lv_matching")
    return ["env", f"ROS_LOG_DIR={folder}", sys.executable, node]


@pytest.mark.nightly
def test_two_robots_with_other_names_and_no_place_to_write_start_and_end(world: RosWorld) -> None:
    places = ["__name:=places", "_memory/file:=/proc/none/views"]
    # A folder that cannot be made, and one that is there but takes no files.
    nowhere = {"one": "/proc/none", "two": "/proc"}
    robots = {
        name: world.run(
            name,
            [*without_logs(nowhere[name]), f"__ns:=/{name}", *places, f"{VIEWS}:=/{name}/views"],
        )
        for name in nowhere
    }
    for name in robots:
        wait_until(lambda name=name: "is ready" in world.log(name), f"{name} to be ready")
    published, heard = state_of(world)
    for name, process in robots.items():
        assert f"/{name}/LocalView/Template" in published and f"/{name}/views" in heard
        assert world.log(name).count("cannot write /proc/none/views") == 1
        assert f"nothing can be written to {nowhere[name]};" in world.log(name)
        assert world.end(process, {"one": signal.SIGINT, "two": signal.SIGTERM}[name]) == 0
        assert "Traceback" not in world.log(name)
    assert "/one/views" not in state_of(world)[1]


@pytest.mark.nightly
def test_a_second_node_of_the_same_name_ends_the_first_one_cleanly(world: RosWorld) -> None:
    first = world.node("lv_builder")
    second = world.node("lv_builder")
    assert first.wait(timeout=PATIENCE_S) == 0 and second.poll() is None
    assert world.end(second) == 0 and "Traceback" not in world.log("lv_builder")


@pytest.mark.nightly
def test_a_node_that_waits_for_the_master_can_be_interrupted(tmp_path: Path) -> None:
    alone = RosWorld(tmp_path)
    process = alone.node("lv_builder", ready=False)
    wait_until(lambda: "master may not be running" in alone.log("lv_builder"), "the attempt")
    assert alone.end(process) == 130
    assert "Traceback" not in alone.log("lv_builder")


def test_a_node_works_off_the_main_thread_in_which_the_handler_of_ctrl_c_runs(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    from fusionslam.ros.ros1 import start

    threads: list[threading.Thread] = []
    monkeypatch.setattr(start, "_init", lambda *given: None)
    monkeypatch.setattr(start, "_serve", lambda *given: threads.append(threading.current_thread()))
    start.start("lv_matching", [])
    assert len(threads) == 1 and threads[0] is not threading.main_thread()


def test_a_node_that_cannot_start_says_why_in_one_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from fusionslam.ros.ros1 import start

    for error, code in ((ConfigError("~source is x", code="no"), 2), (KeyboardInterrupt(), 130)):
        monkeypatch.setattr(start, "_init", Mock(side_effect=error))
        with pytest.raises(SystemExit) as ended:
            start.start("lv_builder", [])
        (line,) = capsys.readouterr().err.splitlines()
        assert ended.value.code == code and "lv_builder: " in line and "Traceback" not in line
