# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""View sources, which recognise places for RatSLAM: visual templates, or a ``ViewMatcher``.

>>> from fusionslam.ratslam.view_sources import TemplateSource
>>> source = TemplateSource(bottom=100)
>>> source.look(np.full((100, 120), 90, np.uint8), stamp_ns=0).view_id
0
"""

import io
import json
import logging
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from fusionslam.base.archive import load_archive, save_archive
from fusionslam.base.argument_types import checked
from fusionslam.base.files import PathLike
from fusionslam.config import merged
from fusionslam.descriptors import DescriptorConfig
from fusionslam.errors import DataError
from fusionslam.fusion import ROBOT_FUSION, FusionConfig
from fusionslam.geometry.se2 import compose
from fusionslam.geometry.trajectory import ground_poses
from fusionslam.ratslam.events import Sighting
from fusionslam.ratslam.external_views import GivenViews
from fusionslam.ratslam.odometry import Limits, Odometry2D, odometry_from, step_between
from fusionslam.sensors.frame import Frame
from fusionslam.sensors.messages import Picture
from fusionslam.views.match import NO_VIEW
from fusionslam.views.matcher import ViewMatcher
from fusionslam.views.recognisers import ViewMatcherConfig, describe_method, find_recogniser
from fusionslam.views.visual_templates import VisualTemplates, VisualTemplatesConfig

logger = logging.getLogger(__name__)

FORMAT = "fusionslam.view_source.1"

Pose = tuple[float, float, float]

_IDENTITY = (0.0, 0.0, 0.0)

_LIMITS = Limits(gap=0.5, max_speed=50.0, max_silence=10.0)
"""The defaults of RatSLAM."""
_SILENT_NS = 2_000_000_000
"""A robot whose last odometry is older than this may be anywhere."""


@runtime_checkable
class ViewSource(Protocol):
    """Recognises places for one ``RatSlam``, which calls it from one thread at a time.

    Attributes:
        kind: its name in saved files.
        title: human-readable name.
    """

    kind: str

    @property
    def title(self) -> str: ...

    @property
    def known(self) -> int:
        """Number of ids given so far, which is the next new id."""

    def look(self, item: Any, stamp_ns: int) -> Sighting:
        """Recognise the view that an item shows; ids count from 0, a new view gets the next one.

        Raises:
            DataError, ShapeError: the item cannot be processed; nothing is stored.
        """

    def to_bytes(self) -> bytes:
        """Everything that ``restore`` needs to resume exactly from here."""

    def restore(self, content: bytes) -> None:
        """Resume from ``to_bytes``. Raises DataError if the bytes are of another kind."""


@checked
class TemplateSource:
    """Recognises views by visual templates, as the original RatSLAM does.

    Items are images, frames with one, and results of ``VisualTemplates.view``.

    Args:
        config: None for the defaults.
        changes: configuration values to override.
    """

    kind = title = "visual templates"

    def __init__(self, config: VisualTemplatesConfig | None = None, **changes: Any) -> None:
        self.templates = VisualTemplates(config, **changes)

    @property
    def known(self) -> int:
        return len(self.templates)

    @checked
    def look(self, item: Any, stamp_ns: int) -> Sighting:
        view = _image_of(item)
        if not (view.ndim == 1 and view.dtype == np.float32):
            view = self.templates.view(view)
        match = self.templates.recognise(view)
        threshold = self.templates.config.threshold
        reason = f"new view {match.id}: the nearest differs by {match.error:.4f} > {threshold:g}"
        if not match.is_new:
            reason = f"matched view {match.id}: it differs by {match.error:.4f} <= {threshold:g}"
        elif not np.isfinite(match.error):
            reason = f"new view {match.id}: none is similar"
        return Sighting(stamp_ns, match.id, match.relative_rotation, reason=reason)

    def to_bytes(self) -> bytes:
        return _bytes_of(self.templates)

    def restore(self, content: bytes) -> None:
        self.templates = VisualTemplates.load(io.BytesIO(content))


@checked
class MatcherSource:
    """Recognises views by a ``ViewMatcher``: alignment, objects, two stages, or a descriptor.

    Items are frames, clouds, and views of the matcher. If views are aligned, the robot's pose
    relative to the view is known, too.

    Args:
        matcher: a new or resumed matcher; None for the default, alignment.
    """

    kind = "view matcher"

    def __init__(self, matcher: ViewMatcher | None = None) -> None:
        # Not "or": an empty matcher is falsy.
        self.matcher = ViewMatcher() if matcher is None else matcher
        # For each scan stored as a further view of a place, by scan number: its pose in the frame
        # of the place's first view, which is where RatSLAM puts the place.
        self._places: dict[int, Pose] = {}
        self._odometry: Odometry2D | None = None
        self._pose, self._interrupted = _IDENTITY, False

    @property
    def title(self) -> str:
        return describe_method(self.matcher.config)

    @property
    def known(self) -> int:
        return self.matcher.stats.new

    @checked
    def follow(self, odometry: Odometry2D) -> None:
        """Follow the robot's motion, by which the next views are weighed (``views.odometry``).

        A stamp earlier than the last one means that the clock went back: the robot may be anywhere
        then, as after a jump or a long silence.
        """
        before, self._odometry = self._odometry, odometry
        if before is None or odometry.stamp_ns == before.stamp_ns:
            return
        if odometry.stamp_ns < before.stamp_ns:
            self._interrupted = True
            return
        motion = step_between(before, odometry, _LIMITS)
        if motion is None:
            return
        self._interrupted |= motion.interrupted
        for v, w, dt in motion.legs:
            x, y, heading = self._pose
            heading += w * dt
            x, y = x + v * dt * math.cos(heading), y + v * dt * math.sin(heading)
            self._pose = x, y, heading

    @checked
    def look(self, item: Any, stamp_ns: int) -> Sighting:
        if isinstance(item, Picture):
            raise DataError(f"image at {stamp_ns} ns: {self.title} needs clouds or frames")
        number = self.matcher.stats.processed
        match = self.matcher.process(item, odometry=self._odometry_at(stamp_ns))
        self._interrupted = False
        if match.by_odometry:  # which RatSLAM knows itself
            return Sighting(stamp_ns, NO_VIEW, reason=match.reason)
        # Of a lost robot RatSLAM decides by itself: it waits for loops that agree.
        view_id = match.id if match.guess is None else match.guess
        # The robot's pose in the frame of the first view of its place.
        x, y, turn = _IDENTITY
        if match.relative_pose is not None and match.matched is not None:
            stored = np.array([self._places.get(match.matched, _IDENTITY)])
            x, y, turn = compose(stored, np.array([match.relative_pose]))[0].tolist()
        if match.stored and not match.is_new:
            self._places[number] = x, y, turn
        return Sighting(stamp_ns, view_id, turn, (x, y), match.reason)

    def _odometry_at(self, stamp_ns: int) -> NDArray[np.float64] | None:
        """odom_from_robot for the matcher; None if it has none, or the robot may be anywhere."""
        matcher, odometry = self.matcher, self._odometry
        if not matcher.config.odometry or not matcher.can_follow_odometry:
            return None
        if odometry is None:
            logger.info("no odometry before the first view: views are compared alone")
            return None
        is_silent = stamp_ns - odometry.stamp_ns > _SILENT_NS
        if is_silent or (self._interrupted and len(matcher)):
            return None
        x, y, heading = self._pose
        return np.asarray(ground_poses(*np.array([[x], [y], [heading]]))[0])

    def to_bytes(self) -> bytes:
        places = json.dumps(
            {
                "places": [[number, *pose] for number, pose in self._places.items()],
                "odometry": self._odometry,
                "pose": self._pose,
                "interrupted": self._interrupted,
            }
        ).encode()
        return len(places).to_bytes(8, "little") + places + _bytes_of(self.matcher)

    def restore(self, content: bytes) -> None:
        start = 8 + int.from_bytes(content[:8], "little")
        matcher = ViewMatcher.load(io.BytesIO(content[start:]))
        stored = json.loads(content[8:start])
        self.matcher = matcher
        self._places = {row[0]: tuple(row[1:]) for row in stored["places"]}
        self._odometry = odometry_from(stored["odometry"])
        self._pose, self._interrupted = tuple(stored["pose"]), bool(stored["interrupted"])


KINDS: Mapping[str, type[TemplateSource] | type[MatcherSource] | type[GivenViews]] = {
    TemplateSource.kind: TemplateSource,
    MatcherSource.kind: MatcherSource,
    GivenViews.kind: GivenViews,
}
"""View sources that can be created when a saved run is loaded, by their name in files."""


@dataclass(frozen=True)
class SourceOptions:
    """Configurations for ``build_view_source``."""

    views: ViewMatcherConfig = field(default_factory=ViewMatcherConfig)
    fusion: FusionConfig = ROBOT_FUSION
    descriptors: DescriptorConfig | None = None
    templates: VisualTemplatesConfig = field(default_factory=VisualTemplatesConfig)


def build_view_source(name: str, options: SourceOptions | None = None) -> ViewSource:
    """Build a new view source for one of ``RECOGNISERS``.

    Raises:
        ConfigError: an unknown name, or a value out of range.
    """
    recogniser, options = find_recogniser(name), options or SourceOptions()
    if recogniser.build is None:
        return TemplateSource(options.templates)
    keeps_ground = {"ground": "none"} if recogniser.keeps_ground else {}
    matcher = ViewMatcher(
        merged(options.views, {"method": name}),
        fusion=merged(options.fusion, keeps_ground),
        descriptors=options.descriptors,
    )
    return MatcherSource(matcher)


def save_source(source: ViewSource, path: PathLike) -> None:
    """Write one .npz atomically. Raises DataError if that fails."""
    arrays = {"views": np.frombuffer(source.to_bytes(), np.uint8)}
    save_archive(path, FORMAT, {"kind": source.kind}, arrays)


def restore_source(source: ViewSource, path: PathLike) -> None:
    """Restore an empty source to what ``save_source`` wrote.

    Raises:
        DataError: the file is missing, truncated, damaged, or of another kind of source; the
            message names it.
    """
    with load_archive(path, FORMAT, "stored views") as (about, arrays):
        if about["kind"] != source.kind:
            raise DataError(f"holds the views of a {about['kind']}, expected {source.kind}")
        source.restore(arrays["views"].tobytes())


def _image_of(item: Any) -> NDArray[Any]:
    if isinstance(item, Picture):
        return item.image
    if isinstance(item, Frame):
        if "left" not in item.images:
            raise DataError(f"frame {item.number}: no left image, which visual templates need")
        return item.images["left"]
    if not isinstance(item, np.ndarray):
        raise DataError(f"{type(item).__name__}: visual templates need an image")
    return item


def _bytes_of(stored: VisualTemplates | ViewMatcher) -> bytes:
    stream = io.BytesIO()
    stored.save(stream)
    return stream.getvalue()
