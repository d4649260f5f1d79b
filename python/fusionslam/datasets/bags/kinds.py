# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Registers bags as kinds of recordings without importing their readers."""

from pathlib import Path

from fusionslam.datasets.bags.reader import bag_kind
from fusionslam.datasets.base import Dataset, Kind
from fusionslam.datasets.streams import Request


def _open(path: Path, request: Request) -> Dataset:
    from fusionslam.datasets.bags.dataset import open_bag_dataset

    return open_bag_dataset(path, request)


def _kind(name: str, layout: str) -> Kind:
    return Kind(name, layout, lambda path: bag_kind(path) == name, _open)


BAGS = (
    _kind("rosbag1", ".bag"),
    _kind("rosbag2", ".db3"),
    _kind("mcap", ".mcap"),
)
