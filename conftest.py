# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Runs the code blocks of README.md, CONTRIBUTING.md and docs/ as tests.

Blocks of a page run in their order, in one namespace and one temporary folder; those of the page on
testing run in the project's. Commands of fusionslam run in this process. The files that pages take
for granted, such as drive.bag, are links in that folder to small recordings. C++ and CMake blocks
are built and run by ctest (``tests/cpp/consumer.cmake``). Blocks of ROS run where ROS 1 is
installed, with drive.bag played as a robot; those that use .venv-ros2 run where it is made. A block
that cannot run here has a comment ``<!-- skip: next "REASON" -->`` above it.
``tests/python/unit/package/test_snippets.py`` checks languages and reasons.
"""

import os

# One thread for each worker of the tests; NumPy's BLAS reads this when it is imported.
os.environ.update(OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1")

import re
import shlex
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from unittest import SkipTest
from unittest.mock import patch

import numpy as np
import pytest
import yaml
from sybil import Example, Sybil
from sybil.parsers.markdown import CodeBlockParser, PythonCodeBlockParser, SkipParser
from typer.testing import CliRunner

from artefacts import artefact, copy_artefact
from fusionslam.cli import app
from fusionslam.cli.system_config import SystemConfig
from fusionslam.config import merged
from fusionslam.datasets.calibration import read_calib_yaml
from fusionslam.views.recognisers import RECOGNISERS

pytest_plugins = ["suite"]
PROJECT = Path(__file__).parent
ROS = re.compile(r"^fusionslam ros (check|launch)", re.MULTILINE)
BASH = ["bash", "-e", "-o", "pipefail", "-c"]
NIGHTLY = {
    f"docs/{page}.md"
    for page in (
        *("guides/training", "guides/calibration", "guides/tuning", "guides/simulation"),
        *("guides/bags", "guides/fleet", "guides/ros", "guides/ros2"),
        *("development/testing", "development/recognisers", "results/views"),
        *("stages/loop_closure", "stages/mapping"),
    )
}
# What make test runs in place of commands that take minutes; make nightly runs them as they are.
LEAN = {
    "fusionslam demo --quick": "fusionslam demo --quick --set sim.drive.spacing_m=14 "
    "--set sim.car.lidar.rings=16 --set sim.car.lidar.azimuths=360",
    "fusionslam ratslam house": "fusionslam ratslam drive.bag",
}
HANGS = 3600  # seconds after which a block hangs, on a machine however busy
# Topics of drive.bag, and those of the robot of docs/guides/ros.md.
ROBOT_TOPICS = {
    "/velodyne_points": "/points",
    "/camera/rgb/image_raw/compressed": "/cam/image/compressed",
    "/camera/rgb/camera_info": "/cam/camera_info",
}


def run_bash(example: Example) -> None:
    """Run a block: commands of ours in this process, others with bash -e, ROS 1 with a robot."""
    block = example.parsed
    if example.namespace["lean"]:
        for text, lean in LEAN.items():
            block = block.replace(text, lean)
    if ROS.search(block):
        _run_with_robot(block)
    elif ".venv-ros2/" in block:
        _run_in_ros2(block)
    elif (commands := _own_commands(block)) is not None:
        for command in commands:
            done = CliRunner().invoke(app, command)
            assert done.exit_code == 0, f"{shlex.join(command)}\n{done.output}"
    else:
        _run([*BASH, block])


def _own_commands(block: str) -> list[list[str]] | None:
    """Arguments of each command, or None where a block needs a shell."""
    if re.search(r"[$|&;<>*]", block):
        return None
    lines = block.replace("\\\n", " ").splitlines()
    commands = [words for line in lines if (words := shlex.split(line, comments=True))]
    return (
        [words[1:] for words in commands] if all(w[0] == "fusionslam" for w in commands) else None
    )


def _run_with_robot(block: str) -> None:
    """Run a block while a bag is played again and again; Ctrl-C ends it once there is a map.

    The blocks of a page share a folder, so that a later one finds the files of an earlier one.
    """
    from ros_master import RosWorld, lacking, wait_until

    if lacking:
        raise SkipTest(lacking)
    folder = Path("ros")
    folder.mkdir(exist_ok=True)
    with RosWorld(folder.absolute()) as world:
        topics = [f"{name}:={other}" for name, other in ROBOT_TOPICS.items()]
        world.run("robot", ["rosbag", "play", "--quiet", "--loop", "../drive.bag", *topics])
        listener = world.listen("/ExperienceMap/Map", "/mapper/cloud")
        world.environment = _environment(world.environment)
        shell = world.run("block", [*BASH, block])
        wait_until(lambda: listener.count() or shell.poll() is not None, "a map")
        assert shell.poll() is None, world.log("block")
        os.killpg(shell.pid, signal.SIGINT)
        assert shell.wait(timeout=HANGS) == 0, world.log("block")


def _run_in_ros2(block: str) -> None:
    """Run a block in a domain of its own; what it leaves in the background ends with it."""
    from benchmarks.ros.ros2_world import lacking, own_domain

    if lacking:
        raise SkipTest(lacking)
    with own_domain() as number, patch.dict(os.environ, ROS_DOMAIN_ID=str(number)):
        _run([*BASH, f"trap 'kill $(jobs -p) 2> /dev/null || true' EXIT\n{block}"])


def check_yaml(example: Example) -> None:
    """Save a block under the name in its first line, ``# NAME.yaml``, for the next blocks to read.

    A calib.yaml is read here. A block without a name holds parameters of ROS nodes.
    """
    first = example.parsed.splitlines()[0]
    if first.startswith("# "):
        path = Path(first.removeprefix("# "))
        path.write_text(example.parsed, encoding="utf-8")
        if path.name == "calib.yaml":
            read_calib_yaml(path)
    else:
        for changes in yaml.safe_load(example.parsed).values():
            merged(SystemConfig(), changes.get("ros__parameters", changes))


def _environment(base: Mapping[str, str]) -> dict[str, str]:
    """As in the project's environment and in its folder, without the data that a clone lacks."""
    kept = {
        name: value
        for name, value in base.items()
        if name != "FUSIONSLAM_TEST_DATA" and not name.startswith("PYTEST_")
    }
    first = {"PATH": Path(sys.executable).parent, "PYTHONPATH": PROJECT}
    for name, folder in first.items():
        kept[name] = os.pathsep.join([str(folder), *filter(None, [kept.get(name)])])
    return kept


def _run(command: list[str]) -> None:
    done = subprocess.run(
        command,
        env=_environment(os.environ),
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        check=False,
        timeout=HANGS,
    )
    assert done.returncode == 0, f"{command[-1]}\n{done.stdout}\n{done.stderr}"


@pytest.fixture(scope="session")
def made_recordings() -> Path:
    """A folder with the files that pages take for granted."""
    return artefact("pages", _make_recordings)


def _make_recordings(folder: Path) -> None:
    from kitti import write_sequence
    from recordings import write_drive

    here = Path.cwd()
    os.chdir(folder)
    slow_camera = "--set robot.cameras.camera.rate_hz=2"
    _run(["bash", "-ec", f"fusionslam sim house -o drive.bag --seconds 6 {slow_camera}"])
    _run([sys.executable, "-c", _SMALL_TOWN])
    _run(["bash", "-ec", "fusionslam views record drive.bag -o scenes.npz --features cm2dp"])
    _run([sys.executable, "-c", _FURNISHED_ROOM])
    # Twice along a street, which is long enough for loops.
    write_sequence(folder / "street", [*range(60)] * 2, [500] * 120, metres=20, width=128)
    write_drive(folder / "warehouse.npz")
    turn = np.linspace(0, 4 * np.pi, 60)  # two rounds of a circle
    poses = np.column_stack([np.cos(turn), np.sin(turn), turn % (2 * np.pi)])
    np.savez("small_house.npz", poses=poses, stamps=2.0 * np.arange(60))
    os.chdir(here)


_SMALL_TOWN = """
from pathlib import Path
from fusionslam.sim import DriveConfig, SimConfig, TownConfig, record

block = ((0, 0), (1, 0), (1, 1), (0, 1), (0, 0))
drive = DriveConfig(laps=(block,), lap_shift_m=(0.0,), spacing_m=30.0)
root = record(SimConfig(town=TownConfig(blocks=(1, 1)), drive=drive), "kitti/dataset", jobs=2)
(root / "sequences" / "00").rename(root / "sequences" / "06")
(root / "poses" / "00.txt").rename(root / "poses" / "06.txt")
"""

_FURNISHED_ROOM = """
import trimesh

room = trimesh.Scene()
for name, size, place in (
    ("floor", (12, 12, 0.02), (0, 0, -0.01)),
    ("wall", (12, 0.1, 2.5), (0, 1.5, 1.25)),
    ("cupboard", (1, 0.5, 1.8), (1, 1, 0.9)),
):
    box = trimesh.creation.box(size)
    box.apply_translation(place)
    room.add_geometry(box, node_name=name, geom_name=name)
room.export("small_house.glb")
"""


RECORDINGS = {
    **{name: name for name in ("drive.bag", "scenes.npz", "small_house.npz", "small_house.glb")},
    **{name: name for name in ("kitti", "warehouse.npz")},
    "DATA": "drive.bag",
    "DRIVE": "street/sequences/03",
    "house.npz": "warehouse.npz",
    "other.npz": "scenes.npz",
}


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> Iterator[None]:
    """Leave pages that take long to the nights, and keep blocks of a page in their order.

    Tests of their commands are quicker.
    """
    for item in items:
        page = item.path.relative_to(PROJECT).as_posix()
        if page.endswith(".md"):
            item.add_marker(pytest.mark.nightly if page in NIGHTLY else pytest.mark.slow)
    yield
    pages: dict[Path, list[int]] = {}
    for place, item in enumerate(items):
        if item.path.suffix == ".md":
            pages.setdefault(item.path, []).append(place)
    for places in pages.values():
        blocks = sorted((items[place] for place in places), key=lambda item: item.reportinfo()[1])
        for place, block in zip(places, blocks, strict=True):
            items[place] = block


@pytest.fixture(scope="session")
def lean(pytestconfig: pytest.Config) -> bool:
    """Whether commands that take minutes are replaced, as they are unless the nights run all."""
    return "not nightly" in pytestconfig.option.markexpr


@pytest.fixture(scope="module")
def page_folder(
    request: pytest.FixtureRequest,
    made_recordings: Path,
    tmp_path_factory: pytest.TempPathFactory,
) -> Iterator[Path]:
    """The working folder of one page: copies of made recordings, and links to those in folders.

    A page may write anew what it reads.
    """
    folder = tmp_path_factory.mktemp("page")
    for name, target in RECORDINGS.items():
        made = made_recordings / target
        if made.is_file():
            copy_artefact(made, folder / name)
        else:
            (folder / name).symlink_to(made)
    (folder / ".venv-ros2").symlink_to(PROJECT / ".venv-ros2")  # if it is there
    here = Path.cwd()
    os.chdir(PROJECT if request.path.name == "testing.md" else folder)
    with patch.dict(RECOGNISERS):  # a page adds one of its own
        yield folder
    os.chdir(here)
    shutil.rmtree(folder)


pytest_collect_file = Sybil(
    parsers=[
        SkipParser(),
        PythonCodeBlockParser(),
        CodeBlockParser("bash", run_bash),
        CodeBlockParser("yaml", check_yaml),
    ],
    patterns=["README.md", "CONTRIBUTING.md", "docs/*.md", "docs/*/*.md", "docs/*/*/*.md"],
    path=str(PROJECT),
    fixtures=["page_folder", "lean"],
).pytest()
