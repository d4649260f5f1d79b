# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What ``fusionslam ros check`` advises users of ROS 1."""

from fusionslam.ros.check.graph import Advice

ADVICE = Advice(
    graph="master",
    parameter=lambda name, value: f"_{name}:={value}",
    remapping=lambda remapping: remapping,
    no_topics="",
    no_clock=(
        "start the simulator or rosbag play --clock; on a real robot rosparam set use_sim_time "
        "false, and restart all nodes"
    ),
    show_bag="RViz needs rosparam set use_sim_time true before rosbag play --clock",
    calibrate="calibrate the camera (rosrun camera_calibration), its driver then publishes it",
    publish=(
        "start robot_state_publisher with the robot's URDF, or rosrun tf2_ros "
        "static_transform_publisher X Y Z YAW PITCH ROLL {parent} {child}"
    ),
    bag_transforms=(
        "a bag sends /tf_static once, at its start: start this first, then rosbag play; on a "
        "robot, "
    ),
    several="nodes hear one of them alone",
    silent="is the sensor connected, is a bag paused or over?",
    unreachable=(
        "set ROS_IP where it runs to an address that is known here; if it crashed, rosnode cleanup"
    ),
    launch=lambda file: ["fusionslam", "ros", "launch", file],
)
