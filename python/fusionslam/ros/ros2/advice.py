# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What ``fusionslam ros2 check`` advises users of ROS 2."""

from fusionslam.ros.check.graph import Advice

ADVICE = Advice(
    graph="graph",
    parameter=lambda name, value: f"-p {name.replace('/', '.')}:={value}",
    remapping=lambda remapping: f"-r {remapping}",
    no_topics=(
        "start the robot, with the same ROS_DOMAIN_ID and RMW_IMPLEMENTATION as here; if it is "
        "another machine, in the same network with multicast, and on both "
        "ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET (the default) or ROS_STATIC_PEERS"
    ),
    no_clock=(
        "start the simulator, or fusionslam ros2 play or ros2 bag play --clock; on a real robot "
        "leave use_sim_time out"
    ),
    show_bag="RViz needs --ros-args -p use_sim_time:=true",
    calibrate=(
        "calibrate the camera (ros2 run camera_calibration cameracalibrator), its driver then "
        "publishes it"
    ),
    publish=(
        "start robot_state_publisher with the robot's URDF, or ros2 run tf2_ros "
        "static_transform_publisher --x X --y Y --z Z --yaw YAW --pitch PITCH --roll ROLL "
        "--frame-id {parent} --child-frame-id {child}"
    ),
    bag_transforms="",
    several="nodes mix the messages of all",
    silent=("is the sensor connected, is a bag paused or over, does a firewall hold back UDP?"),
    unreachable="",
    launch=lambda file: ["ros2", "launch", "fusionslam_ros2", f"{file}.launch.py"],
)
