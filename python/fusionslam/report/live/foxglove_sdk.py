# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Foxglove's SDK; importing this says how to install it if it is missing."""

from fusionslam.errors import FusionSlamError

try:
    import foxglove
    from foxglove import channels, messages
except ImportError as error:
    raise FusionSlamError(
        "this live view needs foxglove-sdk, which is not installed: pip install 'fusionslam[live]'",
        code="missing-extra",
        fields=("live",),
    ) from error

__all__ = ["channels", "foxglove", "messages"]
