# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Methods to compare: recognisers with a preset, and baselines without a sensor.

A method is named after its recogniser (``fusionslam.views.recognisers``) and, unless it is the
default, its preset: "objects", "objects:author". ``METHODS`` holds those of the published tables.
"""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fusionslam.base.progress import Progress, Step, label_progress
from fusionslam.config import explain_choice, merged, split_preset
from fusionslam.descriptors import DESCRIPTORS, DescriptorConfig, find_descriptor
from fusionslam.errors import ConfigError, DataError
from fusionslam.evaluation import ViewRun, baselines
from fusionslam.pipelines.drive_images import template_views
from fusionslam.pipelines.drives import Drive, FrameName, move_clouds
from fusionslam.pipelines.views import OdometryKind, odometry_of, run_views
from fusionslam.sensors.image_series import ImageSeries
from fusionslam.views.matcher import ViewMatcher
from fusionslam.views.recognisers import RECOGNISERS, ViewMatcherConfig
from fusionslam.views.visual_templates import VisualTemplates, VisualTemplatesConfig

_FIRST_STAGE: Mapping[FrameName, str] = {
    "robot": "first stage, robot's frame",
    "odometry": "first stage, world coordinates, perfect odometry",
    "drift": "first stage, world coordinates, drifting odometry",
}


@dataclass(frozen=True)
class Task:
    """One method on one drive.

    Attributes:
        title: title of the table row.
        drive: scans and images.
        frame: frame of the clouds.
        jobs: number of images rendered in parallel.
        step: progress callback.
    """

    title: str
    drive: Drive
    frame: FrameName
    jobs: int = 1
    step: Step | None = None

    def progress(self, what: str) -> Progress:
        """Return a callback that reports progress to ``step``."""
        return label_progress(self.step, f"{self.drive.name}, {self.title}: {what}")


@dataclass(frozen=True)
class Method:
    """A configured recogniser, or a baseline.

    Attributes:
        title: title of its table row.
        help: what it does, in one line.
        run: gives every scan of a drive an id.
        any_frame: whether its result does not depend on the frame of the clouds.
        published: its name in the tables of the thesis; None if it is not there.
        rerun: its name, by frame, among the figures of the thesis's program run again.
        matcher: builds its ``ViewMatcher``, to try other thresholds; None if it has none.
    """

    title: str
    help: str
    run: Callable[[Task], ViewRun]
    any_frame: bool = False
    published: str | None = None
    rerun: Mapping[FrameName, str] = field(default_factory=dict)
    matcher: Callable[[], ViewMatcher] | None = None


def run_matcher(
    build: Callable[[], ViewMatcher],
    *,
    with_ground: bool = False,
    frame: FrameName | None = None,
    odometry: bool = False,
) -> Callable[[Task], ViewRun]:
    """Return a function that runs a ``ViewMatcher`` on a task.

    Args:
        build: builds an empty matcher.
        with_ground: whether clouds keep the ground, if the drive still has it.
        frame: the frame of the clouds, overriding the task's; None for that of the task.
        odometry: whether stored views are weighed by odometry: that of the recording, else one that
            drifts from the true poses.
    """

    def run_task(task: Task) -> ViewRun:
        matcher, drive = build(), task.drive
        scenes = (drive.with_ground if with_ground else None) or drive.scenes
        scenes = move_clouds(scenes, frame or task.frame)
        kind: OdometryKind = "none"
        if odometry:
            kind = "drift" if scenes.odometry is None else "recorded"
        poses = odometry_of(scenes, matcher, kind)
        matches = run_views(scenes, matcher, task.progress("matching"), odometry=poses)
        run = matches.with_truth(task.title, matcher.config.model_dump(mode="json"))
        return replace(run, world=drive.name, images=drive.picture, clouds=drive.cloud)

    return run_task


def run_templates(
    config: VisualTemplatesConfig, *, every_image: bool = False
) -> Callable[[Task], ViewRun]:
    """Return a function that runs visual templates on a task; they process every image.

    Args:
        config: of the templates.
        every_image: whether every image is evaluated; else only the latest one of each scan.
    """

    def run_task(task: Task) -> ViewRun:
        drive, images = task.drive, task.drive.images_with_poses(config.bottom)
        if images is None or not len(images):
            raise DataError("no images", code="no-images")
        views = template_views(
            images, config, jobs=task.jobs, progress=task.progress(images.origin)
        )
        templates, count = VisualTemplates(config), len(views.views)
        ids, similarities, spent = np.empty(count, np.int64), np.empty(count), np.empty(count)
        for row, view in enumerate(views.views):
            begin = time.perf_counter()
            match = templates.recognise(view)
            spent[row] = time.perf_counter() - begin
            ids[row], similarities[row] = match.id, 1 - min(match.error, 1)
        matches: dict[str, Any] = {
            "ids": ids,
            "similarities": similarities,
            "build_seconds": np.full(count, views.build_ms / 1e3),
            "match_seconds": spent,
        }
        at = _at_images(images) if every_image else _at_scans(drive)
        if not every_image:
            rows = latest(images.seconds, drive.scenes.seconds)
            matches = {name: values[rows] for name, values in matches.items()}
        return ViewRun(
            world=drive.name,
            method=f"{task.title}, {images.rate_hz:.3g} Hz" if every_image else task.title,
            **at,
            **matches,
            threshold=1 - config.threshold,
            bytes_per_view=4 * config.columns * config.rows,
            config=config.model_dump(mode="json"),
        )

    return run_task


def _at_images(images: ImageSeries) -> dict[str, Any]:
    if images.poses is None:
        raise DataError("the images have no true poses", code="no-poses")
    return {"poses": images.poses, "stamps": images.seconds}


def _at_scans(drive: Drive) -> dict[str, Any]:
    scenes = drive.scenes
    return {
        "poses": scenes.true_poses(),
        "stamps": scenes.seconds,
        "numbers": scenes.numbers,
        "images": drive.picture,
        "clouds": drive.cloud,
    }


def latest(times: NDArray[np.float64], asked: NDArray[np.float64]) -> NDArray[np.intp]:
    """For each asked time return the row of the last of ``times`` up to it; row 0 if none."""
    # Stamps of the same instant may differ by rounding.
    rows = np.searchsorted(times, asked + 1e-6, side="right") - 1
    return np.maximum(rows, 0)


def run_baseline(name: str) -> Callable[[Task], ViewRun]:
    """Return a function that runs one of ``baselines``, which use no sensor, on a task."""

    def run_task(task: Task) -> ViewRun:
        scenes = task.drive.scenes
        return ViewRun(
            world=task.drive.name,
            method=task.title,
            ids=baselines(len(scenes))[name],
            poses=scenes.true_poses(),
            stamps=scenes.seconds,
            numbers=scenes.numbers,
        )

    return run_task


def _by_recogniser(name: str, preset: str, title: str, **known: Any) -> Method:
    """Return the method of a recogniser of clouds. Raises ConfigError for an unknown preset."""
    recogniser = RECOGNISERS[name]
    config = merged(ViewMatcherConfig(), {"method": name, "preset": preset})
    descriptors = merged(DescriptorConfig(), {"preset": preset})

    def build() -> ViewMatcher:
        return ViewMatcher(config, descriptors=descriptors)

    return Method(
        title,
        known.pop("help", recogniser.help),
        run_matcher(
            build,
            with_ground=recogniser.keeps_ground,
            frame=known.pop("frame", None),
            odometry=known.pop("odometry", False),
        ),
        matcher=build,
        **known,
    )


_ALL_FRAMES: tuple[FrameName, ...] = ("robot", "odometry", "drift")

METHODS: dict[str, Method] = {
    "alignment": _by_recogniser(
        "alignment", "robust", "alignment (ours)", frame="robot", any_frame=True
    ),
    "alignment:odometry": _by_recogniser(
        "alignment",
        "robust",
        "alignment and odometry (ours)",
        help="alignment, weighed by the recording's odometry, else by one that drifts",
        frame="robot",
        odometry=True,
        any_frame=True,
    ),
    "objects:author": _by_recogniser(
        "objects",
        "author",
        "first stage",
        help="objects as the thesis's program compares them, published parameters, threshold 0.737",
        published="first stage",
        rerun=_FIRST_STAGE,
    ),
    # The thresholds of the thesis (0.84, 0.00134) suit only its own weights; 0.5 is even chance.
    "two_stages:author": _by_recogniser(
        "two_stages",
        "author",
        "both stages",
        help="the same, and the thesis's network, trained anew, must agree with every match",
        published="both stages",
    ),
    "visual_templates": Method(
        "templates",
        "grey images of 60x20 blocks, as the original RatSLAM compares them; every image judged",
        run_templates(VisualTemplatesConfig(), every_image=True),
        any_frame=True,
        published="RatSLAM",
        rerun=dict.fromkeys(_ALL_FRAMES, "visual templates of RatSLAM, 10 Hz"),
    ),
    "visual_templates:at_scans": Method(
        "templates, at scans",
        "the same templates, judged at the scans like all others",
        run_templates(VisualTemplatesConfig()),
        any_frame=True,
        published="RatSLAM",
    ),
    "cm2dp": _by_recogniser(
        "cm2dp", "robust", "c-M2DP", help="the descriptor of the first thesis, with the ground"
    ),
    "objects": _by_recogniser(
        "objects", "robust", "objects, robust", help="objects, compared as robustly as we can"
    ),
    "two_stages": _by_recogniser(
        "two_stages",
        "robust",
        "robust, two stages",
        help="our objects, then our network, which must agree with every match",
    ),
    "always_new": Method(
        "no sensor: all new", "every scan is new", run_baseline("always new"), any_frame=True
    ),
    "every_2nd": Method(
        "no sensor: every 2nd",
        "every second scan is new",
        run_baseline("new every 2nd"),
        any_frame=True,
    ),
    "every_3rd": Method(
        "no sensor: every 3rd",
        "every third scan is new",
        run_baseline("new every 3rd"),
        any_frame=True,
        rerun=dict.fromkeys(_ALL_FRAMES, "no sensor: new every 3rd"),
    ),
}
"""Methods of the published tables, our own methods and baselines, compared by ``bench views``."""

BASELINES = ("always_new", "every_2nd", "every_3rd")
"""Names of the methods that use no sensor."""


def method_names() -> tuple[str, ...]:
    """Return the names of all methods: those of ``METHODS``, then every other recogniser."""
    return tuple(dict.fromkeys([*METHODS, *RECOGNISERS]))


def find_method(name: str, key: str = "method") -> Method:
    """Return one of ``METHODS``, or any recogniser with a preset, such as "objects:paper".

    Raises:
        ConfigError: an unknown method or preset; the message begins with ``key``.
    """
    if name in METHODS:
        return METHODS[name]
    recogniser, preset = split_preset(name)
    if recogniser not in RECOGNISERS or RECOGNISERS[recogniser].build is None:
        problem = explain_choice(name, method_names())
        raise ConfigError(f"{key} is {name!r}, {problem}")
    if recogniser in DESCRIPTORS:
        find_descriptor(name)  # refuses presets that it has not
    return _by_recogniser(recogniser, preset or "robust", name.replace(":", ", "))
