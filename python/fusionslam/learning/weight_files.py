# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Weights as safetensors, with the metadata needed to rebuild the network."""

import os
from pathlib import Path

from fusionslam.base.files import reading, write_file
from fusionslam.errors import DataError, FusionSlamError
from fusionslam.learning.pointnet import PointNet
from fusionslam.learning.torch_extra import nn, torch
from fusionslam.views.second_stage.architecture import PointNetConfig
from fusionslam.views.second_stage.network_files import About, check_digest, read_about

_MISSING = "weights need safetensors, which is not installed: pip install 'fusionslam[learn]'"


def save_weights(path: str | os.PathLike[str], network: nn.Module, about: About) -> None:
    """Write a network's weights atomically.

    Raises:
        DataError: the file cannot be written.
        FusionSlamError: safetensors is not installed.
    """
    try:
        from safetensors.torch import save
    except ImportError as error:
        raise FusionSlamError(_MISSING) from error
    # Without the batch counters of batch normalisation, which inference does not use.
    tensors = {
        name: tensor.contiguous()
        for name, tensor in network.state_dict().items()
        if not name.endswith("num_batches_tracked")
    }
    write_file(path, save(tensors, about.metadata()))


def load_pointnet(path: str | os.PathLike[str]) -> tuple[PointNet, About]:
    """Load a feature network that ``save_weights`` wrote, ready for use.

    Raises:
        DataError: the file is missing, truncated, or holds another kind of network or tensors that
            do not fit; the message names it.
        FusionSlamError: safetensors is not installed.
    """
    try:
        from safetensors import safe_open
    except ImportError as error:
        raise FusionSlamError(_MISSING) from error
    check_digest(Path(path))
    with reading(path, "weights of a pointnet network"):
        with safe_open(path, framework="pt") as stored:
            metadata = stored.metadata()
            tensors = {name: stored.get_tensor(name) for name in stored.keys()}  # noqa: SIM118
        about = read_about(Path(path), metadata, "pointnet")
        for name, tensor in tensors.items():
            if not bool(torch.isfinite(tensor).all()):
                raise DataError(f"{name} has values that are not finite", code="not-finite")
        assert isinstance(about.architecture, PointNetConfig)
        network = PointNet(about.architecture)
        network.load_state_dict(tensors)  # names missing, extra and misshapen tensors
    network.eval()
    return network, about
