# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The ways to recognise views that are compared: one registry, ``ENTRANTS``.

A new way is one more entry: a function that makes its ``ViewMatcher``.
"""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from fusionslam.errors import DataError
from fusionslam.evaluation import ViewRun, baselines
from fusionslam.pipelines.drive_images import Images, TemplateViews, template_views
from fusionslam.pipelines.drives import Drive, FrameName, Step, moved
from fusionslam.pipelines.views import run_views
from fusionslam.views.matcher import ViewMatcher, ViewMatcherConfig
from fusionslam.views.visual_templates import VisualTemplates, VisualTemplatesConfig

Floats = NDArray[np.float64]
Preset = Literal["robust", "paper", "author"]

_FIRST_STAGE: Mapping[FrameName, str] = {
    "robot": "first stage, robot's frame",
    "odometry": "first stage, world coordinates, perfect odometry",
    "drift": "first stage, world coordinates, drifting odometry",
}


@dataclass(frozen=True)
class Task:
    """One way on one drive.

    Attributes:
        title: of the row.
        drive: scans and images.
        frame: of the clouds.
        jobs: images rendered at a time.
        step: told about progress.
    """

    title: str
    drive: Drive
    frame: FrameName
    jobs: int = 1
    step: Step | None = None

    def progress(self, what: str) -> Callable[[int, int], None] | None:
        """Tells ``step`` how far something is."""
        if self.step is None:
            return None
        step, label = self.step, f"{self.drive.name}, {self.title}: {what}"
        return lambda done, total: step(label, done, total)


@dataclass(frozen=True)
class Entrant:
    """A way to recognise views.

    Attributes:
        title: of its row.
        help: what it is, in a sentence.
        run: gives every scan of a drive an id.
        any_frame: whether the frame of the clouds makes no difference to it.
        published: what the thesis calls it, if it is in its tables.
        rerun: what it is called, by frame, among the figures that were measured again.
        matcher: makes what it compares with, to try other thresholds; None where there is none.
    """

    title: str
    help: str
    run: Callable[[Task], ViewRun]
    any_frame: bool = False
    published: str | None = None
    rerun: Mapping[FrameName, str] = field(default_factory=dict)
    matcher: Callable[[], ViewMatcher] | None = None


def by_matcher(
    make: Callable[[], ViewMatcher], *, with_ground: bool = False, frame: FrameName | None = None
) -> Callable[[Task], ViewRun]:
    """A run of what a ``ViewMatcher`` recognises.

    Args:
        make: a new matcher.
        with_ground: whether its clouds keep the ground, where it is still there.
        frame: the only one that its clouds can be in; None for any.
    """

    def run(task: Task) -> ViewRun:
        matcher, drive = make(), task.drive
        scenes = (drive.with_ground if with_ground else None) or drive.scenes
        found = run_views(moved(scenes, frame or task.frame), matcher, task.progress("matching"))
        known = found.with_truth(task.title, matcher.config.model_dump(mode="json"))
        return replace(known, world=drive.name, images=drive.picture, clouds=drive.cloud)

    return run


def by_templates(
    config: VisualTemplatesConfig, *, every_image: bool = False
) -> Callable[[Task], ViewRun]:
    """A run of visual templates, which are fed with every image.

    Args:
        config: of the templates.
        every_image: whether every image is judged; else the latest one whenever there is a scan.
    """

    def run(task: Task) -> ViewRun:
        drive, images = task.drive, task.drive.find_images(config.bottom)
        if images is None or not len(images):
            raise DataError("no images")
        made = template_views(images, config, jobs=task.jobs, progress=task.progress(images.origin))
        fed = _fed(VisualTemplates(config), made)
        return ViewRun(
            world=drive.name,
            method=f"{task.title}, {images.rate_hz:.3g} Hz" if every_image else task.title,
            **(_at_images(images, fed) if every_image else _at_scans(drive, images, fed)),
            threshold=1 - config.threshold,
            bytes_per_view=4 * config.columns * config.rows,
            config=config.model_dump(mode="json"),
        )

    return run


@dataclass(frozen=True, eq=False)
class _Fed:
    """What templates made of each image: arrays (n,)."""

    ids: NDArray[np.int64]
    similarities: Floats
    build_seconds: Floats
    match_seconds: Floats

    def at(self, rows: NDArray[np.intp]) -> dict[str, NDArray[Any]]:
        """Those of some images."""
        return {name: values[rows] for name, values in vars(self).items()}


def _fed(templates: VisualTemplates, made: TemplateViews) -> _Fed:
    count = len(made.views)
    ids, similarities, spent = np.empty(count, np.int64), np.empty(count), np.empty(count)
    for row, view in enumerate(made.views):
        begin = time.perf_counter()
        match = templates.recognise(view)
        spent[row] = time.perf_counter() - begin
        ids[row], similarities[row] = match.id, 1 - min(match.error, 1)
    return _Fed(ids, similarities, np.full(count, made.build_ms / 1e3), spent)


def _at_images(images: Images, fed: _Fed) -> dict[str, Any]:
    if images.poses is None:
        raise DataError("the images have no true poses")
    known = fed.at(np.arange(len(images)))
    return {"poses": images.poses, "stamps": images.seconds, **known}


def _at_scans(drive: Drive, images: Images, fed: _Fed) -> dict[str, Any]:
    scenes = drive.scenes
    return {
        "poses": scenes.true_poses(),
        "stamps": scenes.seconds,
        "numbers": scenes.numbers,
        "images": drive.picture,
        "clouds": drive.cloud,
        **fed.at(latest(images.seconds, scenes.seconds)),
    }


def latest(times: NDArray[np.float64], asked: NDArray[np.float64]) -> NDArray[np.intp]:
    """For each time that is asked for the last of the others up to it; the first if none is."""
    # Stamps of the same instant may differ by rounding.
    rows = np.searchsorted(times, asked + 1e-6, side="right") - 1
    return np.maximum(rows, 0)


def by_counting(name: str) -> Callable[[Task], ViewRun]:
    """A run of a program without a sensor: one of ``baselines``."""

    def run(task: Task) -> ViewRun:
        scenes = task.drive.scenes
        return ViewRun(
            world=task.drive.name,
            method=task.title,
            ids=baselines(len(scenes))[name],
            poses=scenes.true_poses(),
            stamps=scenes.seconds,
            numbers=scenes.numbers,
        )

    return run


def _author() -> ViewMatcher:
    return ViewMatcher(ViewMatcherConfig(preset="author"))


def _two_stages(preset: Preset, model: str) -> ViewMatcher:
    """Objects, then a network that may reject them.

    The thesis's thresholds (0.84, 0.00134) belong to its own weights; 0.5 is the even chance.
    """
    return ViewMatcher(ViewMatcherConfig(method="scenes", preset=preset, second_stage=model))


def _both() -> ViewMatcher:
    return _two_stages("author", "thesis")


def _cm2dp() -> ViewMatcher:
    return ViewMatcher(ViewMatcherConfig(method="descriptor", descriptor="cm2dp"))


ENTRANTS: dict[str, Entrant] = {
    "alignment": Entrant(
        "alignment (ours)",
        "our default: scans laid over each other, in the robot's frame",
        by_matcher(ViewMatcher, frame="robot"),
        any_frame=True,
        matcher=ViewMatcher,
    ),
    "first_stage": Entrant(
        "first stage",
        "objects as the thesis's program compares them, published parameters, threshold 0.737",
        by_matcher(_author),
        published="first stage",
        rerun=_FIRST_STAGE,
        matcher=_author,
    ),
    "both_stages": Entrant(
        "both stages",
        "the same, and the thesis's network, trained anew, has to agree with every match",
        by_matcher(_both),
        published="both stages",
        matcher=_both,
    ),
    "templates": Entrant(
        "templates",
        "grey pictures of 60x20 blocks, as the original RatSLAM compares them; every image judged",
        by_templates(VisualTemplatesConfig(), every_image=True),
        any_frame=True,
        published="RatSLAM",
        rerun=dict.fromkeys(("robot", "odometry", "drift"), "visual templates of RatSLAM, 10 Hz"),
    ),
    "templates_at_scans": Entrant(
        "templates, at scans",
        "the same templates, judged at the scans as all others",
        by_templates(VisualTemplatesConfig()),
        any_frame=True,
        published="RatSLAM",
    ),
    "cm2dp": Entrant(
        "c-M2DP",
        "the first thesis's descriptor as the view: nearest stored one within a distance",
        by_matcher(_cm2dp, with_ground=True),
    ),
    "robust": Entrant(
        "objects, robust",
        "our objects and similarity",
        by_matcher(lambda: ViewMatcher(ViewMatcherConfig(method="scenes"))),
    ),
    "robust_two_stages": Entrant(
        "robust, two stages",
        "our objects, then our network, which has to agree with every match",
        by_matcher(lambda: _two_stages("robust", "places")),
    ),
    "always_new": Entrant(
        "no sensor: all new", "every scan is new", by_counting("always new"), any_frame=True
    ),
    "every_2nd": Entrant(
        "no sensor: every 2nd",
        "every second scan is new",
        by_counting("new every 2nd"),
        any_frame=True,
    ),
    "every_3rd": Entrant(
        "no sensor: every 3rd",
        "every third scan is new",
        by_counting("new every 3rd"),
        any_frame=True,
        rerun=dict.fromkeys(("robot", "odometry", "drift"), "no sensor: new every 3rd"),
    ),
}
"""The ways that ``fusionslam bench views`` compares, by what its --methods calls them."""

WITHOUT_SENSOR = ("always_new", "every_2nd", "every_3rd")
"""Those of them that count scans and look at nothing."""
