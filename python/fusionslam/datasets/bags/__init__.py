# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Reads and writes bags of ROS 1, ROS 2 (SQLite) and MCAP through rosbags.

>>> with open_bag("drive.bag") as bag:  # doctest: +SKIP
...     for event in bag.events(["/odom"]):
...         print(event.message.pose)
"""

from fusionslam.datasets.bags.reader import Bag, RawMessage, Topic, open_bag
from fusionslam.datasets.bags.writer import BagWriter, open_writer

__all__ = ["Bag", "BagWriter", "RawMessage", "Topic", "open_bag", "open_writer"]
