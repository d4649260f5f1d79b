# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What the package of colcon installs starts the nodes.

CMake builds fusionslam_ros2 with the ament of the wheels, as colcon does on a machine with ROS 2.
"""

import os
import subprocess
from pathlib import Path

import pytest
import yaml

from benchmarks.ros.ros2_world import JAZZY, Ros2World, lacking
from fusionslam.ros.nodes import NODES
from launch_stand_in import launch, use_stand_in
from project import PROJECT

PACKAGE = PROJECT / "ros2" / "fusionslam_ros2"
pytestmark = [pytest.mark.nightly, pytest.mark.skipif(bool(lacking), reason=lacking)]


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("package")
    environment = os.environ | {
        "PATH": f"{JAZZY}/bin:{os.environ['PATH']}",
        "LD_LIBRARY_PATH": f"{JAZZY}/lib",
        "_ROS_WHEELS_BOOTSTRAP_COMPLETE": "1",  # else each Python starts again
        "CMAKE_PREFIX_PATH": str(JAZZY),
    }
    environment.pop("PYTHONPATH", None)
    prefix, build = folder / "install", str(folder / "build")
    options = [f"-DCMAKE_INSTALL_PREFIX={prefix}", f"-DPython3_EXECUTABLE={JAZZY}/bin/python"]
    for command in (
        ["cmake", "-S", str(PACKAGE), "-B", build, "-DBUILD_TESTING=OFF", *options],
        ["cmake", "--build", build, "--target", "install"],
    ):
        done = subprocess.run(command, env=environment, capture_output=True, text=True)
        assert done.returncode == 0, done.stdout + done.stderr
    return prefix


def test_the_package_installs_nodes_launch_files_and_pictures(installed: Path) -> None:
    programs = [*(installed / "lib" / "fusionslam_ros2").iterdir()]
    assert {each.name for each in programs} == {*NODES, "bag_player"}
    assert all(os.access(each, os.X_OK) for each in programs)
    for name in ("launch", "rviz"):
        found = {each.name for each in (installed / "share" / "fusionslam_ros2" / name).iterdir()}
        assert found == {each.name for each in (PACKAGE / name).iterdir()}
    (module,) = installed.glob("lib/python*/site-packages/fusionslam_ros2/nodes.py")
    assert module.read_text() == (PACKAGE / "fusionslam_ros2" / "nodes.py").read_text()


def test_installed_nodes_run_with_what_a_launch_file_gives_them(
    installed: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    use_stand_in(monkeypatch, PACKAGE)
    file = tmp_path / "parameters.yaml"
    own = {"fusion": {"ground": "height", "voxel": 0.5}, "use_sim_time": True}
    file.write_text(yaml.safe_dump({"data_fusion": {"ros__parameters": own}}))
    given = {"scan": "/points", "odom": "/wheels", "views": "cm2dp", "parameters": str(file)}
    with Ros2World(tmp_path) as world:
        world.environment["PATH"] = f"{JAZZY}/bin:{world.environment['PATH']}"
        share = installed / "share" / "fusionslam_ros2"
        nodes = launch(share / "launch" / "ratslam.launch.py", {**given, "map_file": "map.npz"})
        for node in nodes:
            # As launch_ros starts a node.
            command = [str(installed / "lib" / node.package / node.executable), "--ros-args"]
            command += ["-r", f"__node:={node.name}"]
            for number, each in enumerate(node.parameters):
                if not isinstance(each, str):
                    path = tmp_path / f"{node.name}{number}.yaml"
                    path.write_text(yaml.safe_dump({"/**": {"ros__parameters": dict(each)}}))
                    each = str(path)
                command += ["--params-file", each]
            command += [word for pair in node.remappings for word in ("-r", ":=".join(pair))]
            world.start_node(node.name, command)
        logs = {node.name: world.log(node.name) for node in nodes}
        asking = [str(JAZZY / "bin" / "python"), "-c", _PARAMETERS, "data_fusion"]
        values = world.run("values", asking)
        assert values.wait(timeout=600) == 0, world.log("values")
        assert not any(world.end(each) for each in world.nodes.values())
    assert set(logs) == {"data_fusion", "lv_builder", "lv_matching", "ratslam"}
    assert "/points" in logs["data_fusion"] and "/wheels" in logs["ratslam"]
    # What the file says of the node by its name is stronger than what the launch file gives it.
    assert world.log("values").split() == ["height", "0.5", "True"]


_PARAMETERS = """
import sys
import rclpy
from rclpy.parameter_client import AsyncParameterClient
from rclpy.parameter import parameter_value_to_python

rclpy.init()
node = rclpy.create_node("asking")
client = AsyncParameterClient(node, sys.argv[1])
client.wait_for_services()
future = client.get_parameters(["fusion.ground", "fusion.voxel", "use_sim_time"])
rclpy.spin_until_future_complete(node, future)
print(*map(parameter_value_to_python, future.result().values))
rclpy.shutdown()
"""
