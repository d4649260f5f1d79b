# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The registry of recognisers: every way to recognise a place, by name.

``views.method``, ``fusionslam ratslam --views``, ``fusionslam bench views --methods`` and the ROS
parameter ``source`` take these names. docs/development/recognisers.md shows how to add one.
"""

import logging
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from pydantic import field_validator, model_validator

from fusionslam._core import AlignmentConfig
from fusionslam.config import Section, core_section, explain_choice, merged, option
from fusionslam.descriptors import DESCRIPTORS, DescriptorConfig
from fusionslam.errors import ConfigError
from fusionslam.views.alignment_comparison import AlignmentComparison
from fusionslam.views.comparison import Comparison, ObjectComparison
from fusionslam.views.descriptor_comparison import DescriptorComparison
from fusionslam.views.place_filter import PlaceFilterConfig
from fusionslam.views.scenes import SceneConfig, SimilarityConfig
from fusionslam.views.two_stage_comparison import TwoStageComparison

if TYPE_CHECKING:

    class SceneSection(Section): ...

    class SimilaritySection(Section): ...

    class AlignmentSection(Section): ...

else:
    SceneSection = core_section("SceneSection", SceneConfig, __name__, optional=True)
    SimilaritySection = core_section("SimilaritySection", SimilarityConfig, __name__, optional=True)
    AlignmentSection = core_section("AlignmentSection", AlignmentConfig, __name__)

logger = logging.getLogger(__name__)

OBJECT_THRESHOLDS = {"robust": 0.74, "paper": 0.737, "author": 0.737}
"""Lowest similarity of a match by preset: the published ones; robust, where accuracy and
precision meet."""
ALIGNMENT_THRESHOLD = 0.96
"""Lowest probability at which aligned views match: see docs/stages/views/alignment.md."""


class ViewMatcherConfig(Section):
    """How places are recognised, which views are stored, and when two match."""

    method: str | None = option(
        None,
        "what recognises places: alignment, objects, two_stages, or a descriptor, such as cm2dp; "
        "null is alignment for the robust preset, objects for the others",
    )
    preset: Literal["robust", "paper", "author"] = option(
        "robust", "objects: robust (ours), paper (Stastny 2022) or author (his program)"
    )
    threshold: float | None = option(
        None,
        "similarity, of alignments the probability, from which two views match; null: the "
        "method's and preset's, or max_distance",
        ge=0,
        le=1,
    )
    scene: SceneSection = option(SceneSection(), "objects: values that replace the preset's")
    similarity: SimilaritySection = option(
        SimilaritySection(), "objects: values that replace the preset's"
    )
    alignment: AlignmentSection = option(AlignmentSection(), "alignment: how scenes are aligned")
    max_distance: float = option(
        0.24, "descriptors: largest distance of a match", ge=0, allow_inf_nan=False
    )
    second_stage: str | None = option(
        None,
        "a network that may reject matches: places (ours, uses colours), thesis (Stastny 2022, "
        "trained anew), or the path of features in ONNX; null is none, of two_stages the preset's",
    )
    second_comparison: str | None = option(
        None, "second_stage: path of the comparison in ONNX, for features without calibration"
    )
    second_threshold: float = option(
        0.5, "second_stage: lowest probability that it accepts", ge=0, le=1
    )
    second_start: float | None = option(
        None,
        "second_stage: similarity from which the network is asked; a match below needs no second "
        "opinion; null is threshold: every match has to pass both",
        ge=0,
        le=1,
    )
    min_objects: int = option(
        1,
        "scans with fewer objects get id -1 and are not stored",
        ge=0,
    )
    policy: Literal["first", "several"] = option(
        "first", "stored views of a place: the first, or several that differ"
    )
    store_below: float = option(
        0.85,
        "several: store a match less similar than this as another view of its place",
        ge=0,
        le=1,
    )
    per_place: int = option(5, "several: most views of one place", ge=1)
    threads: int = option(
        1, "threads that compare scenes; 0 is one per core; ids stay the same", ge=0, le=1024
    )
    odometry: bool = option(True, "alignment: weigh stored views by odometry, where there is any")
    places: PlaceFilterConfig = option(PlaceFilterConfig(), "odometry: how it counts")
    max_views: int = option(
        0, "most stored views; the one least likely to be needed is dropped; 0 is no limit", ge=0
    )

    @field_validator("method")
    @classmethod
    def _check_method(cls, name: str | None) -> str | None:
        if name is not None and name not in RECOGNISERS:
            raise ValueError(explain_choice(name, RECOGNISERS))
        return name

    @model_validator(mode="after")
    def _two_stages_need_objects(self) -> "ViewMatcherConfig":
        if second_stage_of(self) is not None and self.min_objects < 1:
            raise ValueError("second_stage needs min_objects of at least 1, not 0")
        return self


@dataclass(frozen=True)
class Recogniser:
    """A way to recognise places.

    Attributes:
        help: description in one line.
        build: builds an empty ``Comparison``; None for visual templates, which compare images.
        keeps_ground: whether it works better on clouds that include the ground.
    """

    help: str
    build: Callable[[ViewMatcherConfig, DescriptorConfig], Comparison] | None
    keeps_ground: bool = False


def _build_alignment(config: ViewMatcherConfig, descriptors: DescriptorConfig) -> Comparison:
    return AlignmentComparison(
        scene_config(config), alignment_config(config), ALIGNMENT_THRESHOLD, threads=config.threads
    )


def _build_objects(config: ViewMatcherConfig, descriptors: DescriptorConfig) -> Comparison:
    limit = OBJECT_THRESHOLDS[config.preset]
    return ObjectComparison(
        scene_config(config), similarity_config(config), limit, threads=config.threads
    )


def _recogniser_by(name: str) -> Recogniser:
    """A recogniser by descriptor distance. The ground helps: see docs/results/views.md."""

    def build(config: ViewMatcherConfig, descriptors: DescriptorConfig) -> Comparison:
        return DescriptorComparison(name, descriptors, config.max_distance)

    return Recogniser(f"distance of {name} descriptors", build, keeps_ground=True)


RECOGNISERS: dict[str, Recogniser] = {
    "alignment": Recogniser("our default: scans aligned with each other", _build_alignment),
    "objects": Recogniser("objects, the first stage of Stastny 2022", _build_objects),
    "two_stages": Recogniser("objects, then a network that has to agree", _build_objects),
    **{name: _recogniser_by(name) for name in DESCRIPTORS},
    "visual_templates": Recogniser("images, as in the original RatSLAM", None),
}
"""Every recogniser by name."""

PLAIN = "m2dp"
"""Recognises clouds without colours, which the default needs."""


def find_recogniser(name: str, key: str = "views") -> Recogniser:
    """Find a recogniser by name. Raises ConfigError, which begins with ``key``, if unknown."""
    if name not in RECOGNISERS:
        raise ConfigError(f"{key} is {name!r}, {explain_choice(name, RECOGNISERS)}")
    return RECOGNISERS[name]


def method_of(config: ViewMatcherConfig) -> str:
    """The recogniser's name; the preset decides it if ``views.method`` is null."""
    return config.method or ("alignment" if config.preset == "robust" else "objects")


def settle_method(config: ViewMatcherConfig, *, colored: bool, name: str) -> ViewMatcherConfig:
    """Return a configuration that recognises clouds without colours unless it names a method.

    Args:
        config: returned as it is if the clouds have colours, or it names a method, a second stage
            or another preset.
        colored: whether the clouds have colours.
        name: of the recording; the log says what replaces the default.
    """
    chosen = config.method is not None or config.second_stage is not None
    if colored or chosen or config.preset != "robust":
        return config
    logger.warning("%s has no colours: %s instead of %s", name, PLAIN, method_of(config))
    return merged(config, {"method": PLAIN})


def second_stage_of(config: ViewMatcherConfig) -> str | None:
    """The network that may reject matches; None for none."""
    if config.second_stage is not None or config.method != "two_stages":
        return config.second_stage
    # The thesis presets go with the thesis network (retrained here), robust with "places".
    return "places" if config.preset == "robust" else "thesis"


def complete_config(config: ViewMatcherConfig) -> ViewMatcherConfig:
    """Name the recogniser and the second stage that the preset decides."""
    names = {"method": method_of(config), "second_stage": second_stage_of(config)}
    return config.model_copy(update=names)


def describe_method(config: ViewMatcherConfig) -> str:
    """The method's title for tables, such as "objects robust, then places"."""
    method, second = method_of(config), second_stage_of(config)
    first = f"objects {config.preset}" if method in ("objects", "two_stages") else method
    return first if second is None else f"{first}, then {second}"


def build_comparison(config: ViewMatcherConfig, descriptors: DescriptorConfig) -> Comparison:
    """Build the empty comparison that a configuration names.

    Raises:
        ConfigError: a value out of range, or a recogniser of images. DataError, FusionSlamError: as
            ``SecondStage``.
    """
    method, second = method_of(config), second_stage_of(config)
    build = find_recogniser(method, "views.method").build
    if build is None:
        raise ConfigError(f"views.method is {method!r}, which compares images instead of clouds")
    first = build(config, descriptors)
    if second is None:
        return first
    from fusionslam.views.second_stage import SecondStage

    return TwoStageComparison(
        first,
        SecondStage(second, config.second_comparison),
        threshold=config.second_threshold,
        start=config.threshold if config.second_start is None else config.second_start,
    )


def alignment_config(config: ViewMatcherConfig) -> AlignmentConfig:
    """The alignment configuration."""
    return AlignmentConfig(**config.alignment.model_dump())


def scene_config(config: ViewMatcherConfig) -> SceneConfig:
    """The scene configuration: the preset with the overridden values."""
    return SceneConfig(preset=config.preset, **config.scene.model_dump(exclude_none=True))


def similarity_config(config: ViewMatcherConfig) -> SimilarityConfig:
    """The similarity configuration: the preset with the overridden values."""
    return SimilarityConfig(preset=config.preset, **config.similarity.model_dump(exclude_none=True))
