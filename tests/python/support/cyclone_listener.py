# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
# mypy: ignore-errors
"""Reads one PointCloud2 of a ROS 2 topic by another vendor's DDS, without any ROS.

    python cyclone_listener.py TOPIC FILE

FILE gets the pickled (stamp in nanoseconds, frame, width, data).
"""

import os
import pickle
import sys
from dataclasses import dataclass

from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import int32, sequence, uint8, uint32
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

PATIENCE_S = 120
LOOPBACK = """<CycloneDDS><Domain>
<General><Interfaces><NetworkInterface name="lo" multicast="true"/></Interfaces></General>
<Discovery><Peers><Peer address="127.0.0.1"/></Peers></Discovery>
</Domain></CycloneDDS>"""


@dataclass
class Time(IdlStruct, typename="builtin_interfaces::msg::dds_::Time_"):
    sec: int32
    nanosec: uint32


@dataclass
class Header(IdlStruct, typename="std_msgs::msg::dds_::Header_"):
    stamp: Time
    frame_id: str


@dataclass
class PointField(IdlStruct, typename="sensor_msgs::msg::dds_::PointField_"):
    name: str
    offset: uint32
    datatype: uint8
    count: uint32


@dataclass
class PointCloud2(IdlStruct, typename="sensor_msgs::msg::dds_::PointCloud2_"):
    header: Header
    height: uint32
    width: uint32
    fields: sequence[PointField]
    is_bigendian: bool
    point_step: uint32
    row_step: uint32
    data: sequence[uint8]
    is_dense: bool


def main() -> None:
    """Wait for the first cloud."""
    os.environ["CYCLONEDDS_URI"] = LOOPBACK
    topic, path = sys.argv[1:]
    participant = DomainParticipant(int(os.environ["ROS_DOMAIN_ID"]))
    quality = Qos(Policy.Reliability.Reliable(duration(seconds=10)), Policy.History.KeepLast(5))
    reader = DataReader(participant, Topic(participant, f"rt{topic}", PointCloud2), qos=quality)
    print("ready", flush=True)
    for cloud in reader.take_iter(timeout=duration(seconds=PATIENCE_S)):
        stamp = cloud.header.stamp
        about = stamp.sec * 10**9 + stamp.nanosec, cloud.header.frame_id, cloud.width
        with open(path, "wb") as file:
            pickle.dump((*about, bytes(cloud.data)), file)
        return
    raise SystemExit(f"nothing came on {topic}")


if __name__ == "__main__":
    main()
