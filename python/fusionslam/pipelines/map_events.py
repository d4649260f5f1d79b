# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The stamped events of a drive: odometry of one kind, and the input of a view source."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from fusionslam.base.progress import Step, label_progress
from fusionslam.config import explain_choice
from fusionslam.errors import ConfigError, DataError, FusionSlamError, ShapeError
from fusionslam.geometry.odometry_noise import DRIFT, OdometryConfig, simulate_odometry
from fusionslam.geometry.trajectory import Trajectory
from fusionslam.odometry import LidarOdometryConfig
from fusionslam.odometry.tracking import scan_odometry
from fusionslam.pipelines.drive_images import estimate_motions, image_stamps_ns, template_views
from fusionslam.pipelines.drives import Drive
from fusionslam.pipelines.lidar_odometry import lidar_motions, track_lidar
from fusionslam.ratslam.events import Event, Look, Motion
from fusionslam.ratslam.view_sources import MatcherSource, TemplateSource, ViewSource
from fusionslam.ratslam.visual_odometry import VisualOdometryConfig
from fusionslam.sensors.messages import Odometry

OdometryName = Literal["topic", "lidar", "inertial", "visual", "truth", "truth+noise"]
ODOMETRY: tuple[str, ...] = get_args(OdometryName)
"""The kinds of odometry."""

_SEEN_DRIFT = {"drift_m": 0.15, "drift_turn": 0.03, "drift_heading": 0.03}

RATE_HZ = 30.0
"""Rate of the odometry messages generated from ground truth."""

_NO_ERRORS = OdometryConfig()


def expected_drift(odometry: str | None) -> dict[str, float]:
    """Map options that differ from the defaults for this kind of odometry.

    Visual odometry drifts more than wheel odometry, and correct loops must not be rejected for it.

    Args:
        odometry: one of ``ODOMETRY``, or None.
    """
    return dict(_SEEN_DRIFT) if odometry == "visual" else {}


@dataclass(frozen=True)
class Unreadable:
    """A scan or image that cannot be read, and why."""

    stamp_ns: int
    error: FusionSlamError


@dataclass(frozen=True, eq=False)
class RunEvents:
    """The input of RatSLAM for one drive.

    Attributes:
        name: of the drive.
        odometry: description of the source of motion, for people.
        motions: odometry in the order of stamps.
        look_stamps_ns: int64 (m), increasing, time stamps of the scans or images.
        item: function from an index into ``look_stamps_ns`` to the scan or image.
        truth: ground-truth trajectory; None if unknown.
    """

    name: str
    odometry: str
    motions: Sequence[Odometry | Motion]
    look_stamps_ns: NDArray[np.int64]
    item: Callable[[int], Any]
    truth: Trajectory | None = None

    def after(self, moved_ns: int | None, looked_ns: int | None) -> "RunEvents":
        """Return the odometry after one stamp and the looks after another; None keeps all.

        Raises:
            DataError: there are no later events.
        """
        motions = [one for one in self.motions if moved_ns is None or one.stamp_ns > moved_ns]
        first = (
            0
            if looked_ns is None
            else int(np.searchsorted(self.look_stamps_ns, looked_ns, side="right"))
        )
        if not motions and first == len(self.look_stamps_ns):
            seconds = max(moved_ns or 0, looked_ns or 0) / 1e9
            raise DataError(
                f"{self.name}: nothing later than {seconds:.3f} s, where the earlier map ended: "
                "resume with a recording that is later, or map this one anew, without --resume",
                code="nothing-later",
            )
        return replace(
            self,
            motions=motions,
            look_stamps_ns=self.look_stamps_ns[first:],
            item=lambda index: self.item(first + index),
        )

    def __len__(self) -> int:
        return len(self.motions) + len(self.look_stamps_ns)

    def __iter__(self) -> Iterator[Event | Unreadable]:
        """Yield the events in the order of their stamps, odometry first at equal stamps; lazily."""
        stamps = [motion.stamp_ns for motion in self.motions]
        places = np.searchsorted(stamps, self.look_stamps_ns, side="right").tolist()
        done = 0
        for look, place in enumerate(places):
            yield from self.motions[done:place]
            done = place
            stamp_ns = int(self.look_stamps_ns[look])
            event: Look | Unreadable
            try:
                event = Look(stamp_ns, self.item(look))
            except (DataError, ShapeError) as error:
                event = Unreadable(stamp_ns, error)
            yield event
        yield from self.motions[done:]


def events_of(
    drive: Drive,
    source: ViewSource,
    odometry: str | None = None,
    errors: OdometryConfig = DRIFT,
    *,
    seen: VisualOdometryConfig | None = None,
    scanned: LidarOdometryConfig | None = None,
    resumed: bool = False,
    continued: bool = False,
    jobs: int = 1,
    progress: Step | None = None,
) -> RunEvents:
    """Return the input of RatSLAM for a drive, from the first view to the last.

    Args:
        drive: scans or images, and the motion.
        source: recognises places.
        odometry: one of ``ODOMETRY``; None for the topic if there is one, else the ground truth.
        errors: odometry errors of "truth+noise".
        seen: configuration of visual odometry; None for the defaults.
        scanned: configuration of odometry by LiDAR; None for the defaults.
        resumed: whether the map began with an earlier recording: the motion before the first view
            counts, too.
        continued: whether a later recording may follow: the motion after the last view counts, too.
        jobs: number of images rendered in parallel.
        progress: rendering progress callback.

    Raises:
        DataError: the drive lacks the requested data. ConfigError: an unknown kind of odometry.
    """
    stamps_ns, item = _looks(drive, source, jobs, progress)
    if odometry == "visual":
        title, motions = estimate_motions(drive, seen, jobs=jobs, progress=progress)
    elif odometry in ("lidar", "inertial"):
        show = label_progress(progress, f"{drive.name}: registering scans")
        chosen = scan_odometry(odometry, scanned)
        track = track_lidar(drive.dataset, chosen, jobs=jobs, progress=show)
        by = "LiDAR" if track.felt is None else "LiDAR and IMU"
        title, motions = f"odometry by {by}", [*lidar_motions(drive.dataset, track)]
    else:
        title, motions = motions_of(drive, odometry, errors)
    used = during(motions, stamps_ns, resumed=resumed, continued=continued)
    return RunEvents(drive.name, title, used, stamps_ns, item, drive.truth)


def motions_of(
    drive: Drive, odometry: str | None, errors: OdometryConfig
) -> tuple[str, list[Odometry | Motion]]:
    """Return a description of the source of motion, and its messages. Raises as ``events_of``."""
    chosen = odometry or _choose_odometry(drive)
    if chosen == "topic":
        return f"topic {drive.dataset.odometry_topic}", [*drive.dataset.motion("odometry")]
    if chosen == "truth":
        return "truth", _simulate_motions(drive, _NO_ERRORS)
    if chosen == "truth+noise":
        values = errors.model_dump(exclude_defaults=True)
        said = ", ".join(f"{name} {value:g}" for name, value in values.items())
        return f"truth with errors ({said or 'none'})", _simulate_motions(drive, errors)
    raise ConfigError(
        f"odometry is {odometry!r}, {explain_choice(str(odometry), ODOMETRY)}",
        code="choice",
        fields=("odometry", str(odometry)),
    )


def _choose_odometry(drive: Drive) -> OdometryName:
    if drive.dataset.odometry_topic is not None:
        return "topic"
    if drive.truth is not None:
        return "truth"
    cures = ["--gt FILE (poses=) names true poses"]
    if drive.dataset.has_points:
        cures.insert(0, "--odometry lidar (odometry='lidar') takes the motion from scans")
    if "left" in drive.dataset.sensors or drive.images() is not None:
        cures.insert(0, "--odometry visual (odometry='visual') takes the motion from images")
    raise DataError(
        f"{drive.name} has neither odometry messages nor true poses: {', '.join(cures)}",
        code="no-motion",
    )


def _simulate_motions(drive: Drive, errors: OdometryConfig) -> list[Odometry | Motion]:
    # At the stamps of the scans, too: a car drives 0.3 m between two regular ones.
    also_ns = drive.stamps_ns if drive.slides else None
    track = simulate_odometry(drive.true_way(), errors, RATE_HZ, also_ns=also_ns)
    if drive.slides:
        rows = zip(track.stamps_ns.tolist(), track.linear, track.angular, strict=True)
        return [Motion(t, float(v[0]), float(w[2]), float(v[1])) for t, v, w in rows]
    return [
        Odometry(
            stamp_ns=int(stamp_ns),
            frame_id="odom",
            child_frame_id="base_footprint",
            pose=pose,
            linear=linear,
            angular=angular,
        )
        for stamp_ns, pose, linear, angular in zip(*track, strict=True)
    ]


def _looks(
    drive: Drive, source: ViewSource, jobs: int, progress: Step | None
) -> tuple[NDArray[np.int64], Callable[[int], Any]]:
    """Return the stamps of the looks, and a function from index to scan or image."""
    if isinstance(source, TemplateSource):
        return _image_looks(drive, source, jobs, progress)
    dataset = drive.dataset
    if "left" in dataset.sensors and not (dataset.has_points or dataset.has_stereo):
        raise DataError(
            f"{drive.name} has images of one camera and no scans, of which {source.title} views "
            "cannot be made: --views visual_templates recognises places by images alone",
            code="no-clouds",
        )
    ground = isinstance(source, MatcherSource) and source.matcher.fusion_config.ground == "none"
    return drive.stamps_ns, lambda index: drive.scan(index, ground=ground)


def _image_looks(
    drive: Drive, source: TemplateSource, jobs: int, progress: Step | None
) -> tuple[NDArray[np.int64], Callable[[int], Any]]:
    """Return the looks at images; rendered images become cached views of visual templates."""
    config = source.templates.config
    images = drive.images(config.bottom)
    if images is None or not len(images):
        raise DataError(f"{drive.name}: no images, which visual templates need", code="no-images")
    stamps_ns = image_stamps_ns(images)
    if images.key is None:
        return stamps_ns, images.image
    show = label_progress(progress, f"{drive.name}: {images.origin}")
    built = template_views(images, config, jobs=jobs, progress=show)
    return stamps_ns, built.views.__getitem__


def during(
    motions: Sequence[Odometry | Motion],
    stamps_ns: NDArray[np.int64],
    *,
    resumed: bool = False,
    continued: bool = False,
) -> list[Odometry | Motion]:
    """Return the odometry from the last one before the first view to the first after the last view.

    Args:
        motions: in the order of stamps.
        stamps_ns: int64 (m), m > 0, increasing stamps of the views.
        resumed, continued: as for ``events_of``.
    """
    stamps = np.array([motion.stamp_ns for motion in motions], np.int64)
    first = max(int(np.searchsorted(stamps, stamps_ns[0], side="right")) - 1, 0)
    last = int(np.searchsorted(stamps, stamps_ns[-1], side="left")) + 1
    return list(motions[0 if resumed else first : None if continued else last])
