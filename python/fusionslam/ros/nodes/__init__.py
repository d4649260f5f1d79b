# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The nodes, by name."""

from importlib import import_module
from typing import Any

from fusionslam.errors import ConfigError

_CLASSES = {
    "data_fusion": "DataFusion",
    "lv_builder": "ViewBuilder",
    "lv_matching": "ViewMatching",
    "ratslam": "Mapper",
    "loop_closure": "LoopClosure",
    "mapper": "PlaceMapper",
    "lv_analyzer": "ViewAnalyzer",
    "lv_dataset_creator": "DatasetCreator",
    "live_view": "LiveView",
}
NODES = tuple(_CLASSES)
"""Their names."""


def node_class(name: str) -> Any:
    """The class of a node. Raises ConfigError for a name that is none of ``NODES``."""
    if name not in _CLASSES:
        raise ConfigError(f"node is {name!r}, expected one of {', '.join(NODES)}")
    return getattr(import_module(f"{__name__}.{name}"), _CLASSES[name])
