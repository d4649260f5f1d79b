# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Inference of the second stage: feature vectors, and the probability of the same place.

>>> from fusionslam.views.second_stage import SecondStage
>>> stage = SecondStage()
>>> stored = stage.features(points, colors)                          # doctest: +SKIP
>>> stage.probability(stage.features(points, colors), stored)        # doctest: +SKIP
0.99
"""

import hashlib
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fusionslam.base.files import reading
from fusionslam.errors import DataError, FusionSlamError, ShapeError
from fusionslam.sensors.frame import Cloud
from fusionslam.views.second_stage.architecture import ComparisonConfig, PointNetConfig
from fusionslam.views.second_stage.inputs import network_input
from fusionslam.views.second_stage.network_files import (
    SHIPPED,
    About,
    Kind,
    check_digest,
    read_about,
)
from fusionslam.views.second_stage.onnx_graph import check_graph
from fusionslam.views.second_stage.scores import probability_of

Features = NDArray[np.float32]

MODELS: Mapping[str, tuple[str, str | None]] = {
    "places": ("places_features.onnx", None),
    "thesis": ("thesis_features.onnx", "thesis_comparison.onnx"),
}
"""The networks that come with the package: features, and the comparison if there is one."""


class SecondStage:
    """Rejects false matches (Stastny 2022, 4.6 and 4.7); runs in onnxruntime on one thread.

    Args:
        model: "places" (trained end to end, with colours; distances are calibrated), "thesis"
            (shapes first, then the comparison; ignores colours), or the path of a feature network
            in ONNX.

    Attributes:
        digest: hash of the feature network's file; features of different networks are not
            comparable.

    Raises:
        DataError: a file is missing, truncated, of another kind or of other sizes, or computes
            what no network of ours does (code "other-operators"); the message names it and what
            was expected.
        FusionSlamError: onnxruntime is not installed.
    """

    def __init__(
        self,
        model: str | os.PathLike[str] = "places",
        comparison: str | os.PathLike[str] | None = None,
    ) -> None:
        self._models = model, comparison
        own, compared = MODELS.get(str(model), (None, None))
        if own is None and not Path(model).exists():
            names = ", ".join(MODELS)
            raise DataError(f"second stage {model}: no such file, expected {names} or a path")
        features = Path(model) if own is None else SHIPPED / own
        if comparison is None and compared is not None:
            comparison = SHIPPED / compared
        self._session, about = _open_session(features, "pointnet")
        self.digest = hashlib.sha256(features.read_bytes()).hexdigest()[:16]
        assert isinstance(about.architecture, PointNetConfig)
        self.config: PointNetConfig = about.architecture
        self._calibration = about.calibration
        self._comparison: Any = None
        if comparison is not None:
            self._comparison, compares = _open_session(Path(comparison), "comparison")
            assert isinstance(compares.architecture, ComparisonConfig)
            size, wanted = compares.architecture.features, self.config.features
            if size != wanted:
                raise DataError(f"{comparison} compares {size} features, expected {wanted}")
        if self._comparison is None and self._calibration is None:
            raise DataError(
                f"{features} has no calibration: expected a comparison beside it",
                code="no-calibration",
            )

    def __reduce__(self) -> Any:
        return type(self), self._models  # another process reads the files again

    def features(
        self, cloud: Cloud | NDArray[np.float32], colors: NDArray[np.uint8] | None = None
    ) -> Features:
        """Compute the features of a scan.

        Args:
            cloud: the whole scene without ground in the robot's frame, or only its points,
                float32 (N, 3), metres.
            colors: uint8 (N, 3) RGB of points, for models that use colours.

        Returns:
            float32 (256,), or as many as the model's ``config.features``.

        Raises:
            ShapeError: a wrong shape, or not one colour per point.
            DataError: no points, points that are not finite, or no colours.
        """
        if isinstance(cloud, Cloud):
            points, colors = cloud.points, cloud.colors
        else:
            points = cloud
        taken = network_input(points, colors, self.config)
        row: Features = self._session.run(None, {"points": taken})[0][0]
        return row

    def probability(self, current: Features, stored: Features) -> float:
        """Probability that two feature vectors (F,) show the same place, 0 to 1."""
        return float(self.probabilities(current, np.asarray(stored)[None])[0])

    def probabilities(self, current: Features, stored: Features) -> Features:
        """``probability`` of one vector (F,) with each of many, (M, F): float32 (M,).

        Raises:
            ShapeError: the vectors have another length.
            DataError: values that are not finite.
        """
        size = self.config.features
        one, many = np.asarray(current, np.float32), np.asarray(stored, np.float32)
        if one.shape != (size,) or many.ndim != 2 or many.shape[1] != size:
            raise ShapeError(
                f"features have shapes {one.shape} and {many.shape}, expected ({size},) and "
                f"(M, {size})"
            )
        if not (np.isfinite(one).all() and np.isfinite(many).all()):
            raise DataError("features must be finite", code="not-finite")
        if self._comparison is not None:
            pair = {
                "current": np.ascontiguousarray(np.broadcast_to(one, many.shape)),
                "stored": many,
            }
            found: Features = self._comparison.run(None, pair)[0][:, 0]
            return found
        assert self._calibration is not None
        distances = np.linalg.norm(many - one, axis=1)
        chance = probability_of(distances, self._calibration.offset, self._calibration.slope)
        return chance.astype(np.float32)


def _open_session(path: Path, kind: Kind) -> tuple[Any, About]:
    try:
        import onnxruntime
    except ImportError as error:
        raise FusionSlamError(
            "the second stage needs onnxruntime, which is not installed: "
            "pip install 'fusionslam[onnx]'"
        ) from error
    options = onnxruntime.SessionOptions()
    # Leave the robot's cores to others: one thread, without spinning while it waits.
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.log_severity_level = 4
    check_digest(path)
    with reading(path, f"a {kind} network in ONNX"):
        data = path.read_bytes()
        check_graph(data)
        session = onnxruntime.InferenceSession(data, options, providers=["CPUExecutionProvider"])
    about = read_about(path, session.get_modelmeta().custom_metadata_map, kind)
    _check_sizes(path, session, about)
    return session, about


def _check_sizes(path: Path, session: Any, about: About) -> None:
    """Raise DataError unless the graph's inputs and result agree with its metadata."""
    if isinstance(about.architecture, PointNetConfig):
        expected = {"points": about.architecture.channels}
    else:
        assert isinstance(about.architecture, ComparisonConfig)
        size = about.architecture.features
        expected = {"current": size, "stored": size}
    found = {value.name: value.shape[-1] for value in session.get_inputs()}
    if found != expected:
        raise DataError(f"{path} takes {found}, expected {expected}: name and length of a row")
    rows = {name: np.zeros((2, size), np.float32) for name, size in expected.items()}
    with reading(path, f"a {about.kind} network in ONNX"):
        (result,) = session.run(None, rows)
    shape = (2, 1) if about.kind == "comparison" else (1, about.architecture.features)
    if result.shape != shape:
        raise DataError(f"{path} gives {result.shape} for 2 rows, expected {shape}")
