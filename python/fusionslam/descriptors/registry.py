# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The list of descriptors. What configures, computes and compares them is derived from it.

A descriptor is one function, of the core or of a Python module, and one entry here. This module
imports nothing heavy: the command line reads its names.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

Need = Literal["colors", "intensities", "normals", "up"]
Invariance = Literal["rotation", "yaw", "translation", "mirror"]

PRESETS = ("robust", "upright", "paper", "author")
"""Presets of M2DP and c-M2DP, the default first."""


@dataclass(frozen=True, kw_only=True)
class Descriptor:
    """A kind of descriptor.

    Attributes:
        name: by which it is chosen.
        length: number of values with the default configuration, and what they are.
        source: where it was published.
        needs: "colors" or "intensities" of the points; "normals", computed from dense
            neighbourhoods; "up": clouds whose z axis points up and whose origin is the scanner or
            the robot (of those with presets see ``needs_up``).
        invariant_to: motions of the sensor that do not change the distance between two clouds,
            but for rounding and the edges of bins: "rotation" about any axis, "yaw" about z,
            "translation"; and "mirror" images, which are taken for the same place.
        metric: how two are compared, as ``DescriptorIndex`` takes it.
        section: key of ``DescriptorConfig`` that holds its own options; None if it has none. The
            core's class ``VfhConfig`` defines those of the section "vfh".
        options: further keys of ``DescriptorConfig`` that change it.
        presets: those it has, the default first.
        extends: the descriptor without colours that it extends; itself if there is none.
        in_robot_frame: values of its section where the configuration gives none and clouds are in
            the robot's frame, which is taken to lie on the ground.
        threads: whether its function takes a number of threads.
        module: that holds its function, of the same name.
        function: of a user's own descriptor, in place of ``module``; it takes points, float32
            (N, 3), the ``point_data`` that it needs, and returns float32 (D,).
    """

    name: str
    length: str
    source: str
    needs: tuple[Need, ...] = ()
    invariant_to: tuple[Invariance, ...] = ()
    metric: str = "l2"
    section: str | None = None
    options: tuple[str, ...] = ()
    presets: tuple[str, ...] = ()
    extends: str | None = None
    in_robot_frame: Mapping[str, float] = field(default_factory=dict)
    threads: bool = False
    module: str = "fusionslam._core"
    function: Callable[..., Any] | None = None

    @property
    def keys(self) -> tuple[str, ...]:
        """Keys of ``DescriptorConfig`` that change it."""
        return self.options if self.section is None else (*self.options, self.section)

    @property
    def point_data(self) -> tuple[Need, ...]:
        """What it needs of a cloud beside points: attributes of ``Cloud``."""
        return tuple(need for need in self.needs if need in POINT_DATA)

    @property
    def needs_colors(self) -> bool:
        return "colors" in self.needs

    @property
    def fits_first(self) -> bool:
        """Whether a sequence's first cloud fixes values that are not configured."""
        return "normal_radius" in self.options or self.section in FITTED_SECTIONS


FITTED_SECTIONS = ("bev_spectrum",)
"""Whose values a sequence's first cloud fixes: ``fit_NAME`` of the core returns them."""

DESCRIPTORS: Mapping[str, Descriptor] = {
    kind.name: kind
    for kind in (
        Descriptor(
            name="m2dp",
            length="192: left (64) and right (128) singular vectors",
            source="He, Wang, Zhang 2016",
            invariant_to=("rotation", "translation", "mirror"),
            section="m2dp",
            options=("preset",),
            presets=PRESETS,
            threads=True,
        ),
        Descriptor(
            name="cm2dp",
            length="576: left (64) and right (512) singular vectors",
            source="Perdomo 2019, chapter 3",
            needs=("colors",),
            invariant_to=("rotation", "translation", "mirror"),
            section="m2dp",
            options=("preset", "color_space"),
            presets=PRESETS,
            extends="m2dp",
            threads=True,
        ),
        Descriptor(
            name="shot",
            length="352: 32 parts of a sphere x 11 angles",
            source="Tombari, Salti, Di Stefano 2010; Perdomo 2019, section 4.1",
            needs=("normals",),
            invariant_to=("rotation", "translation"),
            options=("normal_radius",),
            threads=True,
        ),
        Descriptor(
            name="cshot",
            length="1344: 32 parts of a sphere x (11 angles + 31 colours)",
            source="Tombari, Salti, Di Stefano 2011; Perdomo 2019, section 4.1",
            needs=("colors", "normals"),
            invariant_to=("rotation", "translation"),
            options=("normal_radius",),
            extends="shot",
            threads=True,
        ),
        Descriptor(
            name="scan_context",
            length="1200: 60 sectors x 20 rings",
            source="Kim, Kim 2018",
            needs=("up",),
            invariant_to=("yaw",),
            metric="scan_context",
            section="scan_context",
            in_robot_frame={"height": 0.0},
        ),
        Descriptor(
            name="cscan_context",
            length="3600: 60 sectors x 20 rings x (height, a, b)",
            source="ours, after Kim, Kim 2018",
            needs=("colors", "up"),
            invariant_to=("yaw",),
            metric="scan_context",
            section="scan_context",
            extends="scan_context",
            in_robot_frame={"height": 0.0},
        ),
        Descriptor(
            name="bev_spectrum",
            length="4320: 60 directions x 3 layers x 24 frequencies",
            source="ours, after Reddy, Chatterji 1996",
            needs=("up",),
            invariant_to=("yaw", "translation"),
            metric="scan_context",
            section="bev_spectrum",
            # Of a small robot's scanner nothing may be higher than the ground of wide cells.
            in_robot_frame={"height": 0.0, "cell": 0.4},
        ),
        Descriptor(
            name="scan_context_polar",
            length="1200: 60 sectors x 20 rings",
            source="Kim, Choi, Kim 2022",
            needs=("up",),
            invariant_to=("yaw",),
            metric="aligned_polar",
            section="scan_context_polar",
            in_robot_frame={"height": 0.0},
        ),
        Descriptor(
            name="scan_context_cartesian",
            length="1600: 40 columns across x 40 cells along",
            source="Kim, Choi, Kim 2022",
            needs=("up",),
            metric="aligned_cartesian",
            section="scan_context_cartesian",
            in_robot_frame={"height": 0.0},
        ),
        Descriptor(
            name="intensity_scan_context",
            length="1200: 60 sectors x 20 rings",
            source="Wang, Wang, Xie 2020",
            needs=("intensities", "up"),
            invariant_to=("yaw",),
            metric="intensity_scan_context",
            section="intensity_scan_context",
        ),
        Descriptor(
            name="iris",
            length="28800: 360 columns x (code, mask) x 40 words of 16 bits",
            source="Wang, Sun, Xu, Sarma, Yang, Kong 2020",
            needs=("up",),
            invariant_to=("yaw",),
            metric="iris",
            section="iris",
            # Slices begin as far below the ground as a car's do.
            in_robot_frame={"lowest": -1.0, "highest": 7.0},
        ),
        Descriptor(
            name="solid",
            length="40: bins of range",
            source="Kim, Choi, Sim, Kim, Cho 2024",
            needs=("up",),
            invariant_to=("yaw",),
            section="solid",
            # Seen from the ground, nothing is far below.
            in_robot_frame={"lowest_elevation": -5.0, "highest_elevation": 35.0},
        ),
        Descriptor(
            name="ring",
            length="7200: 120 angles x 60 frequencies",
            source="Lu, Xu, Yin, Chen, Xiong, Wang 2022",
            needs=("up",),
            invariant_to=("yaw", "translation"),
            metric="ring",
            section="ring",
            # A small robot's scanner sees rooms: cells of 0.4 m.
            in_robot_frame={"height": 0.0, "least_height": 0.1, "max_range": 24.0},
        ),
        Descriptor(
            name="ndt_histogram",
            length="220: 4 alignments x 5 shells x 11 classes",
            source="Magnusson, Andreasson, Nüchter, Lilienthal 2009",
            needs=("up",),
            invariant_to=("yaw",),
            metric="nearest_of_set",
            section="ndt_histogram",
            in_robot_frame={"cell": 0.5},
        ),
        Descriptor(
            name="vfh",
            length="308: 45 bins of three angles and of distance, 128 of the angle of view",
            source="Rusu, Bradski, Thibaux, Hsu 2010",
            needs=("normals",),
            invariant_to=("rotation",),
            metric="chi_square",
            section="vfh",
            threads=True,
        ),
        Descriptor(
            name="cvfh",
            length="2464: 8 regions x 308",
            source="Aldoma et al. 2011",
            needs=("normals",),
            invariant_to=("rotation",),
            metric="regions",
            section="cvfh",
            threads=True,
        ),
        Descriptor(
            name="our_cvfh",
            length="2464: 8 regions x 308",
            source="Aldoma, Tombari, Rusu, Vincze 2012",
            needs=("normals",),
            invariant_to=("rotation",),
            metric="regions",
            section="our_cvfh",
            threads=True,
        ),
        Descriptor(
            name="esf",
            length="640: 10 histograms x 64 bins",
            source="Wohlkinger, Vincze 2011",
            invariant_to=("rotation", "translation"),
            metric="l1",
        ),
        Descriptor(
            name="gasd_color",
            length="984: 6 x 6 x 6 cells, 4 x 4 x 4 cells x 12 hues",
            source="Lima, Teichrieb 2016",
            needs=("colors",),
            invariant_to=("yaw", "translation"),
        ),
        Descriptor(
            name="gestalt",
            length="6600: 100 keypoints x (32 means, 32 variances, x, y)",
            source="Bosse, Zlot 2013; Perdomo 2019, section 2.6",
            needs=("up",),
            invariant_to=("yaw", "translation"),
            metric="votes",
            section="gestalt",
            # A small robot's surroundings are smaller, too.
            in_robot_frame={"leaf": 0.1, "radius": 2.0},
            threads=True,
        ),
        Descriptor(
            name="gfh",
            length="4960: 20 rings x 8 layers x 31 frequencies",
            source="Chen et al. 2014; Perdomo 2019, section 2.6",
            needs=("up",),
            invariant_to=("yaw",),
            section="gfh",
        ),
        Descriptor(
            name="cospair",
            length="378: 7 shells x 6 histograms x 9 bins",
            source="Logoglu, Kalkan, Temizel 2016; Perdomo 2019, sections 2.6, 4.1",
            needs=("colors", "normals"),
            invariant_to=("rotation",),
            section="cospair",
            threads=True,
        ),
    )
}
"""Every descriptor by name."""

NAMES = tuple(DESCRIPTORS)

USUAL = ("m2dp", "cm2dp", "shot", "cshot", "scan_context", "cscan_context", "bev_spectrum")
"""Those that commands compare unless others are named."""

GROUPS: Mapping[str, tuple[str, ...]] = {"usual": USUAL, "all": NAMES}
"""Several descriptors by one name; of these, commands leave out what clouds do not allow."""

POINT_DATA: Mapping[Need, str] = {"colors": "colours", "intensities": "intensities"}
"""What a cloud may lack beside its points, by attribute of ``Cloud``, in words."""

SECTIONS = tuple(
    dict.fromkeys(kind.section for kind in DESCRIPTORS.values() if kind.section is not None)
)
"""Keys of ``DescriptorConfig`` that hold options of single descriptors."""
