# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What a descriptor cannot be made of is refused by name.

Empty clouds, NaN and what a cloud lacks: ``test_registry.py``; arrays of another shape or kind:
``tests/python/integration/package/test_refused_arrays.py``.
"""

import math
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np
import pytest

import fusionslam
from fusionslam import ConfigError, DataError, ShapeError, _core
from rows import rows

Refusal = tuple[type[Exception], str | None, Callable[[], object]]


def no_use(
    describe: Callable[..., object], *clouds: Any, says: str | None = None
) -> Iterator[Refusal]:
    """Clouds that hold nothing that this function describes."""
    for cloud in clouds:
        yield DataError, says, partial(describe, np.array(cloud, np.float32))


def out_of_range(section: type, **values: Any) -> Iterator[Refusal]:
    for name, value in values.items():
        yield ConfigError, rf"\.{name}", partial(section, **{name: value})


def sized_m2dp(**sizes: int) -> object:
    return fusionslam.m2dp(ROUGH, config=fusionslam.M2dpConfig(**sizes))


upright_m2dp = partial(fusionslam.m2dp, preset="upright")
POINT = np.ones((1, 3), np.float32)
UP = np.tile(np.float32([0, 0, 1]), (20, 1))
LINE = np.outer(np.arange(50), [1, 2, 3]).astype(np.float32)
GREYS = np.zeros((50, 3), np.uint8)
SPARSE = np.arange(300, dtype=np.float32).reshape(100, 3) * 10
ROUGH = np.random.default_rng(0).uniform(-3, 3, (3000, 3)).astype(np.float32)
SCAN, INTENSITIES = np.full((9, 3), 5, np.float32), np.arange(9, dtype=np.float32)
AZIMUTHS = np.ones(60, np.float32)
CONTEXT = np.ones(1200, np.float32)

intensity = _core.intensity_scan_context


@rows(
    "error, says, call",
    [
        *no_use(fusionslam.bev_spectrum, [[1, 1, -2]], [[60, 0, 0]], [[np.inf, 1, 1]]),
        *out_of_range(fusionslam.BevSpectrumConfig, cell=0.0, height=math.inf),
        *out_of_range(fusionslam.BevSpectrumConfig, cell=math.nan),
        *no_use(fusionslam.scan_context, [[10, 0, -2.5], [90, 1, 5]]),
        (ConfigError, "height", lambda: fusionslam.scan_context(POINT, height=math.nan)),
        *no_use(partial(fusionslam.cscan_context, colors=GREYS[:1]), [[-9, -9, -9]]),
        *no_use(_core.scan_context_polar, [[200, 0, 1]], [[1, 1, -3]], [[np.inf, 1, 1]]),
        *out_of_range(_core.ScanContextPolarConfig, max_range=0.0),
        *no_use(_core.scan_context_cartesian, [[200, 0, 1]], [[1, 1, -3]], [[np.inf, 1, 1]]),
        *out_of_range(_core.ScanContextCartesianConfig, height=math.nan),
        *no_use(partial(intensity, intensities=INTENSITIES), SCAN + 200),
        (DataError, None, lambda: intensity(SCAN, 0 * INTENSITIES)),
        *[
            (DataError, None, partial(intensity, SCAN, np.r_[INTENSITIES[:8], np.float32(bad)]))
            for bad in (-1, np.nan, np.inf)
        ],
        *[
            (ShapeError, None, partial(intensity, SCAN, wrong))
            for wrong in (INTENSITIES[1:], INTENSITIES[:, None], INTENSITIES.astype(np.int32))
        ],
        *out_of_range(_core.IntensityScanContextConfig, max_range=-1.0),
        *no_use(_core.iris, [[90, 0, 0]], [[1, 1, 6]]),
        (ConfigError, "lowest", lambda: _core.iris(POINT, config=_core.IrisConfig(lowest=5.0))),
        *out_of_range(_core.IrisConfig, max_range=math.nan),
        *no_use(_core.ring, [[1, 1, -2]], [[80, 0, 0]]),
        *out_of_range(_core.RingConfig, max_range=0.0),
        *no_use(_core.solid, [[90, 0, 0]], [[1, 0, 9]]),
        *out_of_range(_core.SolidConfig, voxel=0.0),
        (
            ConfigError,
            "lowest_elevation",
            lambda: _core.solid(POINT, config=_core.SolidConfig(lowest_elevation=20.0)),
        ),
        (ShapeError, None, lambda: _core.compare_solid_azimuths(AZIMUTHS, AZIMUTHS[:40])),
        (DataError, None, lambda: _core.compare_solid_azimuths(AZIMUTHS, AZIMUTHS * np.nan)),
        *no_use(_core.ndt_histogram, np.arange(30).reshape(10, 3)),  # no cell has five
        *out_of_range(_core.NdtHistogramConfig, cell=0.0, evenness=2.0, ambiguity=math.nan),
        (ShapeError, None, lambda: fusionslam.compare_scan_contexts(CONTEXT, CONTEXT[:600])),
        (DataError, None, lambda: fusionslam.compare_scan_contexts(CONTEXT, CONTEXT * np.nan)),
        (ShapeError, None, lambda: fusionslam.DescriptorIndex(1199, metric="scan_context")),
        (ConfigError, None, lambda: fusionslam.DescriptorIndex(1200, metric="cosine")),
        *[
            (ConfigError, rf"m2dp\.{name}\b", partial(sized_m2dp, **{name: size}))
            for name, size in (("azimuths", 6), ("sectors", 9))
        ],
        (ConfigError, "best", lambda: fusionslam.cm2dp(LINE, GREYS, preset="best")),
        (ConfigError, "cmyk", lambda: fusionslam.cm2dp(LINE, GREYS, color_space="cmyk")),
        *no_use(upright_m2dp, LINE * [0, 0, 1], says=None),
        *[
            refusal
            for describe in (
                partial(fusionslam.estimate_normals, radius=1.0),
                fusionslam.cloud_resolution,
                fusionslam.shot,
                lambda points: fusionslam.cshot(points, np.zeros(points.shape, np.uint8)),
            )
            for refusal in (
                *no_use(describe, np.empty((0, 3)), says="0"),
                *no_use(describe, [[1, 2, 3]], says="1"),
                *no_use(describe, ROUGH[:50] * 1e30, says="1e15 m"),
            )
        ],
        *[
            (ConfigError, "normal_radius", partial(call, ROUGH[:20], **{name: radius}))
            for call, name in (
                (fusionslam.estimate_normals, "radius"),
                (fusionslam.shot, "normal_radius"),
            )
            for radius in (0.0, -1.0, math.nan)
        ],
        (
            ShapeError,
            r"normals .*19.*points .*20",
            lambda: fusionslam.shot_at_centroid(ROUGH[:20], UP[:19]),
        ),
        (
            DataError,
            "normal 3",
            lambda: fusionslam.shot_at_centroid(
                ROUGH[:20], np.where(np.eye(20)[3][:, None], np.nan, UP)
            ),
        ),
        *no_use(fusionslam.esf, LINE, says="triangles"),
        *no_use(fusionslam.esf, np.ones((50, 3)), says="equal"),
        *no_use(fusionslam.esf, LINE[:2], says="at least 3"),
        *no_use(fusionslam.gfh, [[90, 0, 0], [0, 0, 20]], says="no point within 80"),
        (
            ConfigError,
            r"gfh\.top",
            lambda: fusionslam.gfh(POINT, config=fusionslam.GfhConfig(bottom=2, top=2)),
        ),
        *no_use(fusionslam.gestalt, 3 * SPARSE, says="none has 30"),
        (ShapeError, "colors has 49 rows", lambda: fusionslam.gasd_color(LINE, GREYS[:49])),
        *no_use(partial(fusionslam.gasd_color, colors=GREYS), LINE, says="one line"),
        (ShapeError, "colors has", lambda: fusionslam.cospair(LINE, GREYS[:49])),
        *no_use(partial(fusionslam.cospair, colors=GREYS), SPARSE[:50], says="3 points with a"),
        *[
            refusal
            for describe in (fusionslam.vfh, fusionslam.cvfh, fusionslam.our_cvfh)
            for refusal in (
                *no_use(describe, np.zeros((2, 3)), says="needs at least 3"),
                *no_use(describe, SPARSE, says="3 points with a normal"),
            )
        ],
        *no_use(fusionslam.cvfh, ROUGH, says="no smooth region of 50 points"),
        *no_use(fusionslam.our_cvfh, ROUGH, says="no smooth region of 50 points"),
        *out_of_range(fusionslam.VfhConfig, leaf=0),
        *out_of_range(fusionslam.CvfhConfig, regions=0),
    ],
)
def test_what_cannot_be_described_is_refused(
    error: type[Exception], says: str | None, call: Callable[[], object]
) -> None:
    with pytest.raises(error, match=says):
        call()
