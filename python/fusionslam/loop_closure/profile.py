# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What the first cloud says of a sensor, and how detectors and maps take its clouds."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from fusionslam.config import flatten
from fusionslam.descriptors import DescriptorConfig
from fusionslam.loop_closure.observation import FrameObserver
from fusionslam.registration import RegistrationConfig, measure_reach
from fusionslam.registration.leveling import Level
from fusionslam.sensors.frame import Cloud, Frame
from fusionslam.sensors.point_times import Span
from fusionslam.sensors.undone_motion import Deskew

_ALL_ROUND_DEG = 355.0


@dataclass(frozen=True)
class SensorProfile:
    """What is known of a sensor after its first frame.

    Attributes:
        voxels: that the cloud fills, of ``registration.voxel``.
        degrees: how much of the circle it shows.
        reach: as ``measure_reach``, metres.
        level: how the cloud is levelled; None if it is taken as it is.
        span: seconds from the stamp to the first and to the last point; None if they are unknown.
        deskew: how the motion between them was undone; None if it was not.
        registration, describe: how clouds are registered and described, with what was fitted.
    """

    voxels: int
    degrees: float
    reach: float
    level: Level | None
    span: Span | None
    deskew: Deskew | None
    registration: RegistrationConfig
    describe: DescriptorConfig

    @property
    def chosen(self) -> dict[str, Any]:
        """Values that are not the defaults, by their keys, such as ``registration.voxel``."""
        values = {"registration": self.registration, "descriptors": self.describe}
        found: dict[str, Any] = {}
        for section, config in values.items():
            defaults = flatten(type(config)().model_dump())
            for key, value in flatten(config.model_dump()).items():
                if value != defaults[key]:
                    found[f"{section}.{key}"] = value
        return found

    def rows(self) -> Iterator[tuple[str, str]]:
        """Yield what it says in words, each with a label."""
        around = "all round" if self.degrees > _ALL_ROUND_DEG else f"{self.degrees:.0f} degrees"
        yield (
            "shows",
            f"{around}, half of it within {self.reach:.2g} m, in {self.voxels} voxels of "
            f"{self.registration.voxel:.2g} m",
        )
        if self.level is not None:
            how = "is levelled" if self.level.level_from_cloud is not None else "level enough"
            yield "tilt", f"{self.level.tilt:.1f} degrees by the {self.level.source}, {how}"
        if self.span is None:
            yield "sweep", "points have no times: each scan is taken as of one instant"
        elif self.span[0] == self.span[1]:
            yield "sweep", "all points have one time: each scan is of one instant"
        else:
            first, last = self.span
            how = "motion within it stays"
            if self.deskew is not None:
                how = f"motion within it is undone by {self.deskew.source}"
            yield "sweep", f"{last - first:.3f} s, from {first:+.3f} s of the stamp on; {how}"
        if self.registration.local_map:
            text = f"of {self.registration.local_map:.2g} m, where odometry is known"
        else:
            text = "none: each scan is registered by itself"
        yield "local maps", text
        chosen = ", ".join(
            f"{key}={value:.3g}" if isinstance(value, float) else f"{key}={value}"
            for key, value in self.chosen.items()
        )
        yield "configuration", chosen or "the defaults"


def profile_sensor(frame_or_cloud: Frame | Cloud, observer: FrameObserver) -> SensorProfile:
    """Observe a frame as the first of a detector or map, and say what was fitted to it.

    Args:
        frame_or_cloud: with points.
        observer: that prepares clouds (``FrameObserver.verifying``).

    Raises:
        DataError: a cloud that cannot be made or described.
    """
    first = observer.observe(frame_or_cloud, is_first=True)
    deskew = frame_or_cloud.deskew if isinstance(frame_or_cloud, Frame) else None
    cloud = first.cloud
    assert cloud is not None  # the observer prepares it
    return SensorProfile(
        voxels=len(cloud),
        degrees=cloud.view_degrees,
        reach=measure_reach(cloud.points),
        level=first.level,
        span=first.span if deskew is None else deskew.span,
        deskew=deskew,
        registration=cloud.config,
        describe=first.fitted or observer.describe,
    )
