# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Imports torch, or says how to install it."""

from fusionslam.errors import FusionSlamError

try:
    import torch as torch
    from torch import nn as nn
except ImportError as error:
    raise FusionSlamError(
        "training needs torch, which is not installed: pip install 'fusionslam[learn]'"
    ) from error
